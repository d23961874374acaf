// A device that failed, as opposed to arguments that cannot be: the same work can be done on another one.
#pragma once

#include <stdexcept>

namespace kinevox::kernels {

class DeviceError : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

}  // namespace kinevox::kernels
