#include "client/cli/output.h"

#include <fmt/format.h>
#include <google/protobuf/util/time_util.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "common/proto_time.h"

namespace kinevox::cli {
namespace {

namespace pb = google::protobuf;
using pb::util::TimeUtil;
using Json = nlohmann::ordered_json;

bool is_duration(const pb::FieldDescriptor& field) {
    return field.message_type() && field.message_type()->full_name() == "google.protobuf.Duration";
}

Json message_value(const pb::Message& message) {
    if (const auto* duration = pb::DynamicCastToGenerated<const pb::Duration>(&message))
        return number_or_null(to_seconds(*duration));
    if (const auto* time = pb::DynamicCastToGenerated<const pb::Timestamp>(&message))
        return TimeUtil::ToString(*time);
    return to_json(message);
}

// One value: of a singular field, or the index-th of a repeated one (index >= 0).
Json value_of(const pb::Message& message, const pb::FieldDescriptor& field, int index) {
    const pb::Reflection& get = *message.GetReflection();
    const auto pick = [&](auto single, auto repeated) {
        return index < 0 ? (get.*single)(message, &field) : (get.*repeated)(message, &field, index);
    };
    using R = pb::Reflection;
    if (index < 0 && field.has_presence() && !get.HasField(message, &field)) return nullptr;
    switch (field.cpp_type()) {
        case pb::FieldDescriptor::CPPTYPE_INT32:
            return pick(&R::GetInt32, &R::GetRepeatedInt32);
        case pb::FieldDescriptor::CPPTYPE_INT64:
            return pick(&R::GetInt64, &R::GetRepeatedInt64);
        case pb::FieldDescriptor::CPPTYPE_UINT32:
            return pick(&R::GetUInt32, &R::GetRepeatedUInt32);
        case pb::FieldDescriptor::CPPTYPE_UINT64:
            return pick(&R::GetUInt64, &R::GetRepeatedUInt64);
        case pb::FieldDescriptor::CPPTYPE_DOUBLE:
            return number_or_null(pick(&R::GetDouble, &R::GetRepeatedDouble));
        case pb::FieldDescriptor::CPPTYPE_FLOAT:
            return number_or_null(pick(&R::GetFloat, &R::GetRepeatedFloat));
        case pb::FieldDescriptor::CPPTYPE_BOOL:
            return pick(&R::GetBool, &R::GetRepeatedBool);
        case pb::FieldDescriptor::CPPTYPE_ENUM:
            return short_name(*pick(&R::GetEnum, &R::GetRepeatedEnum));
        case pb::FieldDescriptor::CPPTYPE_STRING: {
            const std::string text = pick(&R::GetString, &R::GetRepeatedString);
            return field.type() == pb::FieldDescriptor::TYPE_BYTES ? Json(text.size()) : Json(text);
        }
        case pb::FieldDescriptor::CPPTYPE_MESSAGE:
            return message_value(index >= 0 ? get.GetRepeatedMessage(message, &field, index)
                                            : get.GetMessage(message, &field));
    }
    return nullptr;
}

}  // namespace

std::string short_name(const pb::EnumValueDescriptor& value) {
    // The values begin with the enum's own name in capitals: CaptureState, CAPTURE_STATE_.
    std::size_t prefix = 1;
    for (const char c : value.type()->name()) prefix += std::isupper(static_cast<unsigned char>(c)) ? 2 : 1;
    prefix -= 1;
    std::string name = value.name().size() > prefix ? value.name().substr(prefix) : value.name();
    std::ranges::transform(name, name.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return name;
}

Json number_or_null(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json to_json(const pb::Message& message) {
    Json out = Json::object();
    const pb::Descriptor& type = *message.GetDescriptor();
    for (int i = 0; i < type.field_count(); ++i) {
        const pb::FieldDescriptor& field = *type.field(i);
        if (!field.is_repeated()) {
            out[field.name() + (is_duration(field) ? "_s" : "")] = value_of(message, field, -1);
            continue;
        }
        Json list = Json::array();
        for (int k = 0; k < message.GetReflection()->FieldSize(message, &field); ++k)
            list.push_back(value_of(message, field, k));
        out[field.name()] = std::move(list);
    }
    return out;
}

Table::Table(const std::vector<std::string>& headers) {
    std::vector<std::string>& row = rows_.emplace_back();
    for (const std::string& header : headers) {
        right_.push_back(header.starts_with('>'));
        row.push_back(right_.back() ? header.substr(1) : header);
    }
}

void Table::add(std::vector<std::string> cells) {
    cells.resize(right_.size());
    rows_.push_back(std::move(cells));
}

std::string Table::text() const {
    std::vector<std::size_t> widths(right_.size(), 0);
    for (const auto& row : rows_)
        for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
    std::string out;
    for (const auto& row : rows_) {
        std::string line;
        for (std::size_t c = 0; c < row.size(); ++c)
            line += right_[c] ? fmt::format("{}{:>{}}", c ? "  " : "", row[c], widths[c])
                              : fmt::format("{}{:<{}}", c ? "  " : "", row[c], widths[c]);
        line.erase(line.find_last_not_of(' ') + 1);
        out += (out.empty() ? "" : "\n") + line;
    }
    return out;
}

std::string count_of(std::uint64_t count, const std::string& noun) {
    return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace kinevox::cli
