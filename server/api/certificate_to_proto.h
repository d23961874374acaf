// A certificate as it is stored, as a message.
#pragma once

#include <string>

#include "kinevox/v1/calibration_service.pb.h"

namespace kinevox {

// certificate_json()'s text. What is missing or of another type is left out.
v1::Certificate certificate_to_proto(const std::string& json);

}  // namespace kinevox
