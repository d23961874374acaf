#include "kernels/body_silhouette.h"

#include <stdexcept>

#include "kernels/cpu/body_silhouette.h"
#include "kernels/cuda/forms.h"

namespace kinevox::kernels {

std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer(Device device) {
    if (device.is_cuda()) {
#ifdef KINEVOX_HAVE_CUDA
        return make_body_silhouette_renderer_cuda(device.index());
#else
        throw std::runtime_error(
            "body silhouette: built without a CUDA compiler; build where nvcc is found, or use device cpu");
#endif
    }
    return make_body_silhouette_renderer_cpu();
}

}  // namespace kinevox::kernels
