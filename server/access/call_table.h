// Which permission each call needs and which role has it, read from access.proto's options as they are linked
// in.
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
// "watch"; empty for a role that is none.
std::string name_of(v1::Role role);
// ROLE_UNSPECIFIED where there is no role of that name.
v1::Role role_named(std::string_view name);
// "watch, exhibit, operate, administer", those that have it.
std::string roles_with(v1::Permission permission);

class CallTable {
  public:
    struct Call {
        v1::Permission permission = v1::PERMISSION_UNSPECIFIED;      // unspecified: nobody may
        const google::protobuf::MethodDescriptor* method = nullptr;  // null for gRPC's own services
        bool audited() const;
    };

    // Services by their full names, "kinevox.v1.CaptureService". gRPC's health and reflection are always in
    // it.
    explicit CallTable(const std::vector<std::string>& services);

    // "/kinevox.v1.CaptureService/Start"; null where there is no such call.
    const Call* find(std::string_view path) const;
    const std::unordered_map<std::string, Call>& calls() const { return calls_; }

  private:
    std::unordered_map<std::string, Call> calls_;
};

// What the values of a request's enumerations need beside its method's permission; unspecified: nothing.
v1::Permission needed_by_values(const google::protobuf::Message& request);

}  // namespace kinevox
