// A device failure, as opposed to invalid arguments: the same work can be done on another device.
#pragma once

#include <stdexcept>

namespace kinevox::kernels {

class DeviceError : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

}  // namespace kinevox::kernels
