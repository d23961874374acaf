#include "server/silhouettes/to_kernel.h"

namespace kinevox {

kernels::CameraModel to_kernel(const Camera& camera) {
    kernels::CameraModel model;
    model.width = camera.width;
    model.height = camera.height;
    model.fx = static_cast<float>(camera.fx);
    model.fy = static_cast<float>(camera.fy);
    model.cx = static_cast<float>(camera.cx);
    model.cy = static_cast<float>(camera.cy);
    model.k1 = static_cast<float>(camera.k1);
    model.k2 = static_cast<float>(camera.k2);
    model.p1 = static_cast<float>(camera.p1);
    model.p2 = static_cast<float>(camera.p2);
    model.k3 = static_cast<float>(camera.k3);
    for (int n = 0; n < 9; ++n)
        model.rotation_camera_from_world[n] = static_cast<float>(camera.camera_from_world.rotation.m[n]);
    const Vec3 t = camera.camera_from_world.translation;
    model.translation_camera_from_world[0] = static_cast<float>(t.x);
    model.translation_camera_from_world[1] = static_cast<float>(t.y);
    model.translation_camera_from_world[2] = static_cast<float>(t.z);
    return model;
}

kernels::ImageView to_kernel(const Image& image) {
    return {image.data.get(), image.width, image.height, image.channels,
            static_cast<std::ptrdiff_t>(image.width) * image.channels};
}

}  // namespace kinevox
