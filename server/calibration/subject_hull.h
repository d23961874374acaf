// The hull of one moment's silhouettes, carved strictly, for measuring with.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "server/calibration/silhouette_set.h"

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

    // False where two cameras' silhouettes that their pictures do not cut are missing.
    bool carve(const std::vector<SilhouettePicture>& pictures);
    // Centres of the carved hull's voxels, m, world.
    std::vector<Vec3> voxels() const;
    // The carved hull as a camera sees it: height * width bytes, 0 or 255.
    void project(std::size_t camera, std::vector<std::uint8_t>& mask) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
