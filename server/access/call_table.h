// The permission that each method requires and the roles that grant it, from access.proto's options.
#pragma once

#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "kinevox/v1/access.pb.h"

namespace google::protobuf {
class Message;
class MethodDescriptor;
}  // namespace google::protobuf

namespace kinevox {

bool has(v1::Role role, v1::Permission permission);
// "viewer"; empty for no role.
std::string name_of(v1::Role role);
// ROLE_UNSPECIFIED for an unknown name.
v1::Role role_named(std::string_view name);
// "viewer, display, operator, admin": those that grant it.
std::string roles_with(v1::Permission permission);

class CallTable {
  public:
    struct Call {
        v1::Permission permission = v1::PERMISSION_UNSPECIFIED;      // unspecified: refused
        const google::protobuf::MethodDescriptor* method = nullptr;  // null for gRPC's own services
        bool audited() const;
    };

    // Services by their full names, "kinevox.v1.CaptureService". gRPC's health and reflection are always
    // included.
    explicit CallTable(const std::vector<std::string>& services);

    // "/kinevox.v1.CaptureService/StartCapture"; null for an unknown method.
    const Call* find(std::string_view path) const;
    const std::unordered_map<std::string, Call>& calls() const { return calls_; }

  private:
    std::unordered_map<std::string, Call> calls_;
};

// The permission that the enum values of a request require in addition to its method's; unspecified: none.
v1::Permission needed_by_values(const google::protobuf::Message& request);

}  // namespace kinevox
