#include "server/access/call_table.h"

#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <cctype>

namespace kinevox {
namespace {

constexpr std::string_view kRolePrefix = "ROLE_";

// Their packages declare no permissions.
constexpr const char* kOwnCallsOfGrpc[] = {"/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch",
                                           "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"};

// The permission that lists it among its methods or enum values.
template <typename Option>
v1::Permission naming(const Option& option, std::string_view what) {
    const auto* permissions = v1::Permission_descriptor();
    for (int i = 0; i < permissions->value_count(); ++i) {
        const auto& options = permissions->value(i)->options();
        for (int n = 0; n < options.ExtensionSize(option); ++n)
            if (options.GetExtension(option, n) == what)
                return static_cast<v1::Permission>(permissions->value(i)->number());
    }
    return v1::PERMISSION_UNSPECIFIED;
}

std::string lower(std::string text) {
    std::ranges::transform(text, text.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
}

}  // namespace

bool has(v1::Role role, v1::Permission permission) {
    const auto* value = v1::Role_descriptor()->FindValueByNumber(role);
    if (!value || permission == v1::PERMISSION_UNSPECIFIED) return false;
    const auto& options = value->options();
    for (int i = 0; i < options.ExtensionSize(v1::grants); ++i)
        if (options.GetExtension(v1::grants, i) == permission) return true;
    return false;
}

std::string name_of(v1::Role role) {
    if (role == v1::ROLE_UNSPECIFIED || !v1::Role_IsValid(role)) return "";
    return lower(v1::Role_Name(role).substr(kRolePrefix.size()));
}

v1::Role role_named(std::string_view name) {
    const auto* roles = v1::Role_descriptor();
    for (int i = 0; i < roles->value_count(); ++i)
        if (const auto role = static_cast<v1::Role>(roles->value(i)->number());
            !name.empty() && name_of(role) == name)
            return role;
    return v1::ROLE_UNSPECIFIED;
}

std::string roles_with(v1::Permission permission) {
    std::string out;
    const auto* roles = v1::Role_descriptor();
    for (int i = 0; i < roles->value_count(); ++i)
        if (const auto role = static_cast<v1::Role>(roles->value(i)->number()); has(role, permission))
            out += (out.empty() ? "" : ", ") + name_of(role);
    return out;
}

bool CallTable::Call::audited() const {
    return permission == v1::PERMISSION_OPERATE || permission == v1::PERMISSION_ADMIN;
}

CallTable::CallTable(const std::vector<std::string>& services) {
    for (const char* path : kOwnCallsOfGrpc) calls_[path] = {v1::PERMISSION_STATUS, nullptr};
    for (const std::string& name : services) {
        const auto* service = google::protobuf::DescriptorPool::generated_pool()->FindServiceByName(name);
        for (int i = 0; service && i < service->method_count(); ++i) {
            const auto* method = service->method(i);
            calls_["/" + name + "/" + method->name()] = {
                naming(v1::methods, service->name() + "." + method->name()), method};
        }
    }
}

const CallTable::Call* CallTable::find(std::string_view path) const {
    const auto found = calls_.find(std::string(path));
    return found == calls_.end() ? nullptr : &found->second;
}

v1::Permission needed_by_values(const google::protobuf::Message& request) {
    const auto* descriptor = request.GetDescriptor();
    for (int i = 0; i < descriptor->field_count(); ++i) {
        const auto* field = descriptor->field(i);
        if (field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_ENUM || field->is_repeated())
            continue;
        const auto* value =
            field->enum_type()->FindValueByNumber(request.GetReflection()->GetEnumValue(request, field));
        if (!value) continue;  // the handler rejects it
        if (const auto needed = naming(v1::enum_values, descriptor->name() + "." + value->name()))
            return needed;
    }
    return v1::PERMISSION_UNSPECIFIED;
}

}  // namespace kinevox
