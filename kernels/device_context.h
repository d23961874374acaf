#pragma once

#include <memory>

namespace kinevox::kernels {

// What the segmenters whose frames are compared share on a GPU: the stream on which all of them work. Stages
// of one StageFactory have the same one, on its GPU.
class DeviceContext {
  public:
    virtual ~DeviceContext() = default;
};

}  // namespace kinevox::kernels
