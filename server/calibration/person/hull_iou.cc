#include "server/calibration/person/hull_iou.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {

HullIou hull_iou(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                 const HullIouOptions& options) {
    const std::size_t all = silhouettes.frame_sets.size(),
                      used = std::min<std::size_t>(all, options.max_frame_sets), count = cameras.size();
    std::vector<std::vector<double>> iou(used, std::vector<double>(count, std::nan("")));
    oneapi::tbb::parallel_for(std::size_t{0}, used, [&](std::size_t n) {
        const auto& images = silhouettes.frame_sets[n * all / used];
        const SilhouetteHull hull(cameras, images);
        if (!hull.usable()) return;
        for (std::size_t c = 0; c < count; ++c) {
            if (!hull.field(c) || images[c].truncated) continue;
            const auto& mask = images[c].mask;
            const auto area = static_cast<double>(mask.size() - std::count(mask.begin(), mask.end(), 0));
            const int step = std::max(1, static_cast<int>(std::sqrt(area / options.pixels)));
            std::int64_t inside = 0, asked = 0;
            for (int y = 0; y < cameras[c].height; y += step)
                for (int x = 0; x < cameras[c].width; x += step) {
                    if (!mask[static_cast<std::size_t>(y) * cameras[c].width + x]) continue;
                    const auto answer = hull.meets(c, cameras[c].ray_through({1.0 * x, 1.0 * y}),
                                                   options.radius_m, options.step_m);
                    asked += answer != SilhouetteHull::Meets::kUnseen;
                    inside += answer == SilhouetteHull::Meets::kYes;
                }
            if (asked > 0) iou[n][c] = static_cast<double>(inside) / static_cast<double>(asked);
        }
    });
    HullIou out;
    double total = 0;
    int counted = 0;
    for (std::size_t c = 0; c < count; ++c) {
        double sum = 0;
        int frame_sets = 0;
        for (const auto& frame_set : iou)
            if (!std::isnan(frame_set[c])) sum += frame_set[c], ++frame_sets;
        out.iou.push_back(frame_sets ? sum / frame_sets : std::nan(""));
        total += sum, counted += frame_sets;
    }
    for (const auto& frame_set : iou)
        out.frames +=
            std::any_of(frame_set.begin(), frame_set.end(), [](double v) { return !std::isnan(v); });
    out.mean_iou = counted ? total / counted : 0;
    return out;
}

}  // namespace kinevox
