#include "server/calibration/agreement_pictures.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "server/calibration/subject_hull.h"

namespace kinevox {
namespace {

constexpr int kWidth = 270, kHeight = 360;  // px
constexpr double kMarginPart = 0.12;        // around the subject

const cv::Vec3b kNothing(48, 36, 27), kBoth(240, 240, 240), kSilhouetteOnly(0, 94, 213),
    kHullOnly(210, 140, 30);

// The moment that most cameras see, whole at best; of those the one nearest to the middle of the recording.
std::size_t best_moment(const SilhouetteSet& silhouettes) {
    std::size_t best = 0;
    double most = -1;
    for (std::size_t m = 0; m < silhouettes.moments.size(); ++m) {
        double score = 0;
        for (const SilhouettePicture& picture : silhouettes.moments[m])
            score += picture.empty() ? 0 : picture.cut ? 0.5 : 1;
        const double place = static_cast<double>(m) / static_cast<double>(silhouettes.moments.size());
        score -= 0.4 * std::abs(place - 0.5);
        if (score > most) most = score, best = m;
    }
    return best;
}

std::string drawn(const cv::Mat& silhouette, const cv::Mat& hull) {
    const cv::Rect subject = cv::boundingRect(silhouette | hull);
    // The subject in the middle of a frame of the page's proportions.
    const double high =
        std::max<double>(subject.height, subject.width * double(kHeight) / kWidth) * (1 + 2 * kMarginPart);
    const double scale = kHeight / high;
    const double x = subject.x + 0.5 * subject.width, y = subject.y + 0.5 * subject.height;
    const cv::Matx23d picture_from_pixel(scale, 0, 0.5 * kWidth - scale * x, 0, scale,
                                         0.5 * kHeight - scale * y);
    cv::Mat colours(silhouette.size(), CV_8UC3, cv::Scalar(kNothing)), out;
    colours.setTo(kSilhouetteOnly, silhouette);
    colours.setTo(kHullOnly, hull);
    colours.setTo(kBoth, silhouette & hull);
    cv::warpAffine(colours, out, picture_from_pixel, cv::Size(kWidth, kHeight),
                   scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(kNothing));
    std::vector<std::uint8_t> png;
    cv::imencode(".png", out, png);
    return {png.begin(), png.end()};
}

}  // namespace

std::vector<AgreementPicture> agreement_pictures(const std::vector<Camera>& cameras,
                                                 const SilhouetteSet& silhouettes) {
    std::vector<AgreementPicture> out;
    if (silhouettes.moments.empty()) return out;
    const std::vector<SilhouettePicture>& pictures = silhouettes.moments[best_moment(silhouettes)];
    SubjectHull hull(cameras, {.voxel_m = 0.01});
    if (!hull.carve(pictures)) return out;
    std::vector<std::uint8_t> projected;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (pictures[c].empty()) continue;
        hull.project(c, projected);
        const cv::Size size(cameras[c].width, cameras[c].height);
        const cv::Mat silhouette(size, CV_8U, const_cast<std::uint8_t*>(pictures[c].mask.data()));
        const cv::Mat of_hull(size, CV_8U, projected.data());
        if (cv::countNonZero(silhouette) == 0) continue;
        out.push_back({cameras[c].name, drawn(silhouette, of_hull)});
    }
    return out;
}

}  // namespace kinevox
