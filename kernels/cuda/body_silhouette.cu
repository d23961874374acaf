// The renderer on the device: a block of 16 x 16 pixels of one view holds all capsules in that camera's frame
// in shared memory, and each thread tries its pixel's ray on them.
#include <cuda_runtime.h>

#include <algorithm>
#include <vector>

#include "kernels/cpu/body_silhouette.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/shared/body_silhouette.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kTile = 16;            // px
constexpr int kSharedCapsules = 64;  // at a time

struct DeviceView {
    Projector camera;
    std::size_t offset;  // of the mask, bytes
};

__global__ void render_bodies(const TaperedCapsule* body, int capsules, const DeviceView* views,
                              std::uint8_t* masks, int4* bounds) {
    __shared__ CameraCapsule shared[kSharedCapsules];
    __shared__ bool seen[kSharedCapsules];
    const DeviceView& view = views[blockIdx.z];
    const Projector& camera = view.camera;
    const int x = blockIdx.x * kTile + threadIdx.x, y = blockIdx.y * kTile + threadIdx.y;
    if (static_cast<int>(blockIdx.x) * kTile >= camera.width ||
        static_cast<int>(blockIdx.y) * kTile >= camera.height)
        return;  // the whole block
    const bool inside = x < camera.width && y < camera.height;
    float nx = 0, ny = 0;
    undistorted(camera, static_cast<float>(x), static_cast<float>(y), nx, ny);
    bool hit = false;
    const int thread = threadIdx.y * kTile + threadIdx.x;
    for (int first = 0; first < capsules; first += kSharedCapsules) {
        const int count = min(kSharedCapsules, capsules - first);
        __syncthreads();
        if (thread < count) seen[thread] = capsule_in_camera(camera, body[first + thread], shared[thread]);
        __syncthreads();
        for (int n = 0; n < count && !hit; ++n) hit = seen[n] && ray_meets_capsule(shared[n], nx, ny);
    }
    if (!inside) return;
    masks[view.offset + static_cast<std::size_t>(y) * camera.width + x] = hit ? 255 : 0;
    if (hit) {
        int4& box = bounds[blockIdx.z];
        atomicMin(&box.x, x);
        atomicMin(&box.y, y);
        atomicMax(&box.z, x + 1);
        atomicMax(&box.w, y + 1);
    }
}

class CudaBodySilhouetteRenderer final : public BodySilhouetteRenderer {
  public:
    explicit CudaBodySilhouetteRenderer(int gpu) : stream_(gpu) {}

    void render(std::span<const TaperedCapsule> body, std::span<BodyView> views) override {
        check_capsules(body);
        if (views.empty()) return;
        stream_.use();
        host_views_.resize(views.size());
        host_bounds_.resize(views.size());
        std::size_t bytes = 0;
        int width = 0, height = 0;
        for (std::size_t n = 0; n < views.size(); ++n) {
            const CameraModel& camera = *views[n].camera;
            host_views_[n] = {projectors_.get(camera), bytes};
            host_bounds_[n] = {camera.width, camera.height, 0, 0};
            bytes += static_cast<std::size_t>(camera.width) * camera.height;
            width = std::max(width, camera.width), height = std::max(height, camera.height);
        }
        host_body_.resize(body.size());
        std::copy(body.begin(), body.end(), host_body_.data());
        masks_.resize(bytes);
        host_masks_.resize(bytes);
        upload(stream_, body_, host_body_);
        upload(stream_, views_, host_views_);
        upload(stream_, bounds_, host_bounds_);
        const dim3 tiles((width + kTile - 1) / kTile, (height + kTile - 1) / kTile,
                         static_cast<unsigned>(views.size()));
        render_bodies<<<tiles, dim3(kTile, kTile), 0, stream_.get()>>>(
            body_.data(), static_cast<int>(body.size()), views_.data(), masks_.data(), bounds_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        download(stream_, host_masks_.data(), masks_.data(), bytes);
        download(stream_, host_bounds_.data(), bounds_.data(), views.size());
        stream_.wait();
        for (std::size_t n = 0; n < views.size(); ++n) {
            const std::size_t size =
                static_cast<std::size_t>(views[n].camera->width) * views[n].camera->height;
            std::copy_n(host_masks_.data() + host_views_[n].offset, size, views[n].mask);
            const int4 box = host_bounds_[n];
            views[n].bounds = box.z > box.x ? Rect{box.x, box.y, box.z, box.w} : Rect{};
        }
    }

  private:
    Stream stream_;
    ProjectorCache projectors_;
    DeviceBuffer<TaperedCapsule> body_;
    DeviceBuffer<DeviceView> views_;
    DeviceBuffer<std::uint8_t> masks_;
    DeviceBuffer<int4> bounds_;
    PinnedBuffer<TaperedCapsule> host_body_;
    PinnedBuffer<DeviceView> host_views_;
    PinnedBuffer<std::uint8_t> host_masks_;
    PinnedBuffer<int4> host_bounds_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer_cuda(int gpu) {
    cuda::require_gpu("body silhouette", gpu);
    return std::make_unique<cuda::CudaBodySilhouetteRenderer>(gpu);
}

}  // namespace kinevox::kernels
