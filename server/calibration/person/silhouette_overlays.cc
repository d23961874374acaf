#include "server/calibration/person/silhouette_overlays.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "server/calibration/person/subject_hull.h"
#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr int kWidth = 270, kHeight = 360;  // px
constexpr double kMarginFraction = 0.12;    // around the subject

const cv::Vec3b kOutside(48, 36, 27), kBoth(240, 240, 240), kSilhouetteOnly(0, 94, 213),
    kHullOnly(210, 140, 30);

// The frame set that most cameras see, untruncated if possible; of those the one nearest to the centre of the
// session.
std::size_t best_frame_set(const SilhouetteSet& silhouettes) {
    std::size_t best = 0;
    double most = -1;
    for (std::size_t m = 0; m < silhouettes.frame_sets.size(); ++m) {
        double score = 0;
        for (const SilhouetteMask& image : silhouettes.frame_sets[m])
            score += image.empty() ? 0 : image.truncated ? 0.5 : 1;
        const double position = static_cast<double>(m) / static_cast<double>(silhouettes.frame_sets.size());
        score -= 0.4 * std::abs(position - 0.5);
        if (score > most) most = score, best = m;
    }
    return best;
}

std::string drawn(const cv::Mat& silhouette, const cv::Mat& hull) {
    const cv::Rect subject = cv::boundingRect(silhouette | hull);
    // The subject centred in a frame of the page's proportions.
    const double high = std::max<double>(subject.height, subject.width * double(kHeight) / kWidth) *
                        (1 + 2 * kMarginFraction);
    const double scale = kHeight / high;
    const double x = subject.x + 0.5 * subject.width, y = subject.y + 0.5 * subject.height;
    const cv::Matx23d image_from_pixel(scale, 0, 0.5 * kWidth - scale * x, 0, scale,
                                       0.5 * kHeight - scale * y);
    cv::Mat colours(silhouette.size(), CV_8UC3, cv::Scalar(kOutside)), out;
    colours.setTo(kSilhouetteOnly, silhouette);
    colours.setTo(kHullOnly, hull);
    colours.setTo(kBoth, silhouette & hull);
    cv::warpAffine(colours, out, image_from_pixel, cv::Size(kWidth, kHeight),
                   scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(kOutside));
    std::vector<std::uint8_t> png;
    cv::imencode(".png", out, png);
    return {png.begin(), png.end()};
}

}  // namespace

std::vector<SilhouetteOverlay> silhouette_overlays(const std::vector<Camera>& cameras,
                                                   const SilhouetteSet& silhouettes) {
    std::vector<SilhouetteOverlay> out;
    if (silhouettes.frame_sets.empty()) return out;
    const std::vector<SilhouetteMask>& images = silhouettes.frame_sets[best_frame_set(silhouettes)];
    SubjectHull hull(cameras, {.voxel_m = 0.01});
    if (!hull.carve(images)) return out;
    std::vector<std::uint8_t> projected;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (images[c].empty()) continue;
        hull.project(c, projected);
        const cv::Size size(cameras[c].width, cameras[c].height);
        const cv::Mat silhouette = as_mat(images[c].mask.data(), size.width, size.height);
        const cv::Mat of_hull(size, CV_8U, projected.data());
        if (cv::countNonZero(silhouette) == 0) continue;
        out.push_back({cameras[c].name, drawn(silhouette, of_hull)});
    }
    return out;
}

}  // namespace kinevox
