#include "server/calibration/hull_agreement.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/calibration/silhouette_hull.h"

namespace kinevox {

HullAgreement hull_agreement(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                             const HullAgreementOptions& options) {
    const std::size_t all = silhouettes.moments.size(),
                      used = std::min<std::size_t>(all, options.max_moments), count = cameras.size();
    std::vector<std::vector<double>> iou(used, std::vector<double>(count, std::nan("")));
    oneapi::tbb::parallel_for(std::size_t{0}, used, [&](std::size_t n) {
        const auto& pictures = silhouettes.moments[n * all / used];
        const SilhouetteHull hull(cameras, pictures);
        if (!hull.usable()) return;
        for (std::size_t c = 0; c < count; ++c) {
            if (!hull.field(c) || pictures[c].cut) continue;
            const auto& mask = pictures[c].mask;
            const auto area = static_cast<double>(mask.size() - std::count(mask.begin(), mask.end(), 0));
            const int step = std::max(1, static_cast<int>(std::sqrt(area / options.pixels)));
            std::int64_t inside = 0, asked = 0;
            for (int y = 0; y < cameras[c].height; y += step)
                for (int x = 0; x < cameras[c].width; x += step) {
                    if (!mask[static_cast<std::size_t>(y) * cameras[c].width + x]) continue;
                    const auto answer = hull.meets(c, cameras[c].ray_through({1.0 * x, 1.0 * y}),
                                                   options.reach_m, options.step_m);
                    asked += answer != SilhouetteHull::Meets::kUnseen;
                    inside += answer == SilhouetteHull::Meets::kYes;
                }
            if (asked > 0) iou[n][c] = static_cast<double>(inside) / static_cast<double>(asked);
        }
    });
    HullAgreement out;
    double total = 0;
    int counted = 0;
    for (std::size_t c = 0; c < count; ++c) {
        double sum = 0;
        int moments = 0;
        for (const auto& moment : iou)
            if (!std::isnan(moment[c])) sum += moment[c], ++moments;
        out.iou.push_back(moments ? sum / moments : std::nan(""));
        total += sum, counted += moments;
    }
    for (const auto& moment : iou)
        out.frames += std::any_of(moment.begin(), moment.end(), [](double v) { return !std::isnan(v); });
    out.mean_iou = counted ? total / counted : 0;
    return out;
}

}  // namespace kinevox
