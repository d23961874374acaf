// A stored certificate as a message.
#pragma once

#include <string>
#include <string_view>

#include "kinevox/v1/calibration_service.pb.h"

namespace kinevox {

// From the text of certificate_json(). Members that are missing or of another type are absent. The method of
// a certificate, or of a stored calibration, by its name in JSON ("extrinsics_wand"); UNSPECIFIED for an
// unknown one.
v1::CalibrationMethod calibration_method_to_proto(std::string_view name);
v1::Certificate certificate_to_proto(const std::string& json);

}  // namespace kinevox
