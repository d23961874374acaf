// The API's messages as JSON for scripts: field names as in the .proto, numbers as numbers (64-bit ones too),
// enums by their short name in lower case, durations as seconds under NAME_s, timestamps in RFC 3339, NaN and
// absent values as null, bytes by their length.
#pragma once

#include <google/protobuf/message.h>

#include <nlohmann/json.hpp>

namespace kinevox::cli {

// NaN and infinities as null.
nlohmann::ordered_json number_or_null(double value);

nlohmann::ordered_json to_json(const google::protobuf::Message& message);

// CAPTURE_STATE_RUNNING of CaptureState becomes "running".
std::string short_name(const google::protobuf::EnumValueDescriptor& value);

}  // namespace kinevox::cli
