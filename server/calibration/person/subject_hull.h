// Voxel hull of one frame set's silhouettes, carved strictly, for measurements.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

struct SubjectHullOptions {
    double voxel_m = 0.015;
    double side_m = 2.6;  // of the box around the subject
};

// Not thread safe.
class SubjectHull {
  public:
    SubjectHull(const std::vector<Camera>& cameras, const SubjectHullOptions& options);
    ~SubjectHull();

    // False with fewer than two untruncated silhouettes.
    bool carve(const std::vector<SilhouetteMask>& images);
    // Centres of the hull's voxels, m, world.
    std::vector<Vec3> voxels() const;
    // The hull's projection into a camera: height * width bytes, 0 or 255.
    void project(std::size_t camera, std::vector<std::uint8_t>& mask) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
