#include "server/calibration/hull_agreement.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "kernels/hull.h"
#include "kernels/projection.h"
#include "server/calibration/triangulation.h"
#include "server/pipeline/convert.h"

namespace kinevox {
HullAgreement hull_agreement(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                             const HullAgreementOptions& options) {
    kernels::HullOptions strict;
    strict.min_views = cameras.size() >= 4 ? 3 : 2;
    strict.fill_reach_m = 0;
    const auto carver = kernels::make_hull_carver(kernels::Device::kCpu, strict);
    std::vector<kernels::CameraModel> models;
    for (const Camera& camera : cameras) models.push_back(to_kernel(camera));
    std::vector<double> sum(cameras.size(), 0);
    std::vector<int> count(cameras.size(), 0);
    HullAgreement out;
    const std::size_t all = silhouettes.moments.size(),
                      used = std::min<std::size_t>(all, options.most_moments);
    kernels::VoxelVolume volume;
    std::vector<std::uint8_t> mask;
    for (std::size_t n = 0; n < used; ++n) {
        const auto& pictures = silhouettes.moments[n * all / used];
        std::vector<kernels::HullView> views;
        std::vector<Sight> sights;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (pictures[c].empty()) continue;
            const cv::Rect bounds = cv::boundingRect(cv::Mat(cameras[c].height, cameras[c].width, CV_8U,
                                                             const_cast<std::uint8_t*>(pictures[c].mask.data())));
            if (bounds.empty()) continue;
            const kernels::Rect box{bounds.x, bounds.y, bounds.x + bounds.width, bounds.y + bounds.height};
            views.push_back({&models[c], pictures[c].mask.data(), nullptr, box});
            if (!pictures[c].cut)
                sights.push_back({&cameras[c], {0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)}});
        }
        const auto middle = triangulate(sights);
        if (!middle || views.size() < 2) continue;
        kernels::Lattice lattice;
        lattice.voxel_m = static_cast<float>(options.voxel_m);
        const int size = 8 * static_cast<int>(std::ceil(options.side_m / options.voxel_m / 8));
        const double centre[3] = {middle->x, middle->y, middle->z};
        for (int axis = 0; axis < 3; ++axis) {
            lattice.size[axis] = size;
            lattice.origin[axis] = static_cast<float>(centre[axis] - 0.5 * size * options.voxel_m);
        }
        carver->carve(views, lattice, volume);
        ++out.frames;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (pictures[c].empty() || pictures[c].cut) continue;
            mask.assign(pictures[c].mask.size(), 0);
            kernels::Rect box;
            const float still[3] = {0, 0, 0};
            kernels::project_volume(volume, models[c], still, 0, mask.data(), box);
            std::int64_t both = 0, either = 0;
            for (std::size_t i = 0; i < mask.size(); ++i) {
                const bool a = mask[i] != 0, b = pictures[c].mask[i] != 0;
                both += a && b, either += a || b;
            }
            if (either == 0) continue;
            sum[c] += static_cast<double>(both) / static_cast<double>(either);
            ++count[c];
        }
    }
    double total = 0;
    int counted = 0;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        out.iou.push_back(count[c] ? sum[c] / count[c] : std::nan(""));
        total += sum[c], counted += count[c];
    }
    out.mean_iou = counted ? total / counted : 0;
    return out;
}

}  // namespace kinevox
