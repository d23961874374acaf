#include "server/pipeline/tracking/elsewhere.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

#include "server/pipeline/tracking/cone_box.h"

namespace kinevox {
namespace {

constexpr int kBlock_px = 8, kStep_px = 2;  // of each block every second pixel is read
constexpr std::uint8_t kForeground = 128;   // probability
constexpr int kMinPersonHeight = 12;        // 1/12 of the image height
constexpr int kMinPersonArea = 250;         // 1/250 of its square

// A pixel per block: whether half of it or more is foreground, and none of it in `subject`.
cv::Mat foreground_blocks(const kernels::Silhouettes& s, const kernels::Rect& subject) {
    cv::Mat blocks(s.height / kBlock_px, s.width / kBlock_px, CV_8U, cv::Scalar(0));
    constexpr int kRead = (kBlock_px / kStep_px) * (kBlock_px / kStep_px);
    for (int row = 0; row < blocks.rows; ++row)
        for (int column = 0; column < blocks.cols; ++column) {
            const int x0 = column * kBlock_px, y0 = row * kBlock_px;
            if (overlap({x0, y0, x0 + kBlock_px, y0 + kBlock_px}, subject)) continue;
            int count = 0;
            for (int y = y0; y < y0 + kBlock_px; y += kStep_px) {
                const std::uint8_t* const line =
                    s.probability.data() + static_cast<std::ptrdiff_t>(y) * s.width;
                for (int x = x0; x < x0 + kBlock_px; x += kStep_px) count += line[x] >= kForeground;
            }
            blocks.at<std::uint8_t>(row, column) = 2 * count >= kRead;
        }
    return blocks;
}

// How far a box in the image extends along the world's vertical: along its columns if the camera is turned to
// portrait format, in any direction if it looks down.
int along_vertical(const Camera& camera, int columns, int rows) {
    constexpr double kSinOblique = 0.5;
    const Vec3 up = camera.camera_from_world.rotation * Vec3{0, 0, 1};
    if (std::hypot(up.x, up.y) < kSinOblique) return std::max(columns, rows);
    return std::abs(up.x) > std::abs(up.y) ? columns : rows;
}

}  // namespace

bool shows_person_outside(const Camera& camera, const kernels::Silhouettes& s, const kernels::Rect& subject) {
    if (s.probability.empty()) return false;
    cv::Mat labels, components, centres;
    const int count = cv::connectedComponentsWithStats(foreground_blocks(s, subject), labels, components,
                                                       centres, 8, CV_32S);
    for (int i = 1; i < count; ++i) {
        const int height = along_vertical(camera, components.at<int>(i, cv::CC_STAT_WIDTH),
                                          components.at<int>(i, cv::CC_STAT_HEIGHT));
        const std::int64_t blocks = components.at<int>(i, cv::CC_STAT_AREA);
        if (height * kBlock_px * kMinPersonHeight >= s.height &&
            blocks * kBlock_px * kBlock_px * kMinPersonArea >= std::int64_t{s.height} * s.height)
            return true;
    }
    return false;
}

}  // namespace kinevox
