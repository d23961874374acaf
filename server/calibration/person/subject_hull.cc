#include "server/calibration/person/subject_hull.h"

#include <bit>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "kernels/hull.h"
#include "kernels/projection.h"
#include "server/calibration/triangulation.h"
#include "server/cameras/image_mat.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {

struct SubjectHull::State {
    std::vector<Camera> cameras;
    SubjectHullOptions options;
    std::vector<kernels::CameraModel> models;
    std::unique_ptr<kernels::HullCarver> carver;
    kernels::VoxelVolume volume;
};

SubjectHull::SubjectHull(const std::vector<Camera>& cameras, const SubjectHullOptions& options)
    : state_(std::make_unique<State>()) {
    state_->cameras = cameras;
    state_->options = options;
    kernels::HullOptions strict;
    strict.min_views = cameras.size() >= 4 ? 3 : 2;
    strict.fill_radius_m = 0;
    state_->carver = kernels::make_hull_carver(kernels::Device::kCpu, strict);
    for (const Camera& camera : cameras) state_->models.push_back(to_kernel(camera));
}

SubjectHull::~SubjectHull() = default;

bool SubjectHull::carve(const std::vector<SilhouetteMask>& images) {
    std::vector<kernels::HullView> views;
    std::vector<Observation> observations;
    for (std::size_t c = 0; c < state_->cameras.size(); ++c) {
        if (images[c].empty()) continue;
        const Camera& camera = state_->cameras[c];
        const cv::Rect bounds = cv::boundingRect(as_mat(images[c].mask.data(), camera.width, camera.height));
        if (bounds.empty()) continue;
        const kernels::Rect box{bounds.x, bounds.y, bounds.x + bounds.width, bounds.y + bounds.height};
        views.push_back({&state_->models[c], images[c].mask.data(), box});
        if (!images[c].truncated)
            observations.push_back({&camera, {0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)}});
    }
    const auto middle = triangulate(observations);
    if (!middle || views.size() < 2) return false;
    const SubjectHullOptions& options = state_->options;
    kernels::Lattice lattice;
    lattice.voxel_m = static_cast<float>(options.voxel_m);
    const int size = 8 * static_cast<int>(std::ceil(options.side_m / options.voxel_m / 8));
    const double centre[3] = {middle->x, middle->y, middle->z};
    for (int axis = 0; axis < 3; ++axis) {
        lattice.size[axis] = size;
        lattice.origin[axis] = static_cast<float>(centre[axis] - 0.5 * size * options.voxel_m);
    }
    state_->carver->carve(views, lattice, state_->volume);
    return true;
}

std::vector<Vec3> SubjectHull::voxels() const {
    std::vector<Vec3> out;
    const kernels::Lattice& lattice = state_->volume.lattice;
    const double edge = lattice.voxel_m;
    for (const kernels::Brick& brick : state_->volume.bricks)
        for (int z = 0; z < kernels::kBrickEdge; ++z)
            for (std::uint64_t bits = brick.occupancy[z]; bits != 0; bits &= bits - 1) {
                const int bit = std::countr_zero(bits);
                out.push_back({lattice.origin[0] + edge * (brick.x * kernels::kBrickEdge + bit % 8 + 0.5),
                               lattice.origin[1] + edge * (brick.y * kernels::kBrickEdge + bit / 8 + 0.5),
                               lattice.origin[2] + edge * (brick.z * kernels::kBrickEdge + z + 0.5)});
            }
    return out;
}

void SubjectHull::project(std::size_t camera, std::vector<std::uint8_t>& mask) const {
    const Camera& c = state_->cameras[camera];
    mask.assign(static_cast<std::size_t>(c.width) * c.height, 0);
    kernels::Rect box;
    const float still[3] = {0, 0, 0};
    kernels::project_volume(state_->volume, state_->models[camera], still, 0, mask.data(), box);
}

}  // namespace kinevox
