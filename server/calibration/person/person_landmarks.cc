#include "server/calibration/person/person_landmarks.h"

#include <oneapi/tbb/parallel_for.h>

#include <cmath>
#include <limits>

namespace kinevox {
namespace {

// Direction of the body's axis in a camera's image, over all frame sets; the camera is rolled by less than 60
// degrees.
Vec2 image_up(const Camera& camera, const SilhouetteSet& silhouettes, std::size_t c) {
    double cosine = 0, sine = 0;  // of twice the axis' angle: an axis has no sign
    for (const auto& images : silhouettes.frame_sets) {
        if (images[c].empty() || images[c].truncated) continue;
        double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
        for (int y = 0; y < camera.height; y += 2)
            for (int x = 0; x < camera.width; x += 2) {
                if (!images[c].mask[static_cast<std::size_t>(y) * camera.width + x]) continue;
                n += 1, sx += x, sy += y, sxx += 1.0 * x * x, syy += 1.0 * y * y, sxy += 1.0 * x * y;
            }
        if (n < 1) continue;
        const double cxx = sxx - sx * sx / n, cyy = syy - sy * sy / n, cxy = sxy - sx * sy / n;
        const double size = cxx + cyy;
        if (size > 0)
            cosine += (cxx - cyy) / size, sine += 2 * cxy / size;  // elongated bodies carry more information
    }
    if (cosine == 0 && sine == 0) return {0, -1};
    const double angle = 0.5 * std::atan2(sine, cosine);
    const Vec2 axis{std::cos(angle), std::sin(angle)};
    if (std::abs(axis.y) < 0.5) return {0, -1};  // lying all the time
    return axis.y < 0 ? axis : Vec2{-axis.x, -axis.y};
}

std::optional<PersonLandmarks> landmarks_of(const Camera& camera, const SilhouetteMask& image, Vec2 up) {
    double most = -std::numeric_limits<double>::max(), least = -most, n = 0;
    Vec2 middle, upper, top;
    const auto each = [&](const auto& body) {
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x)
                if (image.mask[static_cast<std::size_t>(y) * camera.width + x])
                    body(x, y, up.x * x + up.y * y);
    };
    each([&](int x, int y, double along) {
        most = std::max(most, along), least = std::min(least, along);
        middle.x += x, middle.y += y, n += 1;
    });
    if (n < 50) return std::nullopt;
    const double third = most - (most - least) / 3, tip = most - std::max(1.5, 0.01 * (most - least));
    double in_third = 0, in_tip = 0;
    each([&](int x, int y, double along) {
        if (along >= third) upper.x += x, upper.y += y, in_third += 1;
        if (along >= tip) top.x += x, top.y += y, in_tip += 1;
    });
    return PersonLandmarks{Vec2{top.x / in_tip, top.y / in_tip}, Vec2{upper.x / in_third, upper.y / in_third},
                           Vec2{middle.x / n, middle.y / n}};
}

}  // namespace

std::vector<std::vector<std::optional<PersonLandmarks>>> person_landmarks(
    const std::vector<Camera>& intrinsics, const SilhouetteSet& silhouettes) {
    std::vector<std::vector<std::optional<PersonLandmarks>>> out(
        silhouettes.frame_sets.size(), std::vector<std::optional<PersonLandmarks>>(intrinsics.size()));
    oneapi::tbb::parallel_for(std::size_t{0}, intrinsics.size(), [&](std::size_t c) {
        const Vec2 up = image_up(intrinsics[c], silhouettes, c);
        for (std::size_t m = 0; m < out.size(); ++m)
            if (const SilhouetteMask& image = silhouettes.frame_sets[m][c];
                !image.empty() && !image.truncated)
                out[m][c] = landmarks_of(intrinsics[c], image, up);
    });
    return out;
}

}  // namespace kinevox
