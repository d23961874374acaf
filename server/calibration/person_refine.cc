#include "server/calibration/person_refine.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "server/calibration/diagnosis.h"
#include "server/calibration/hull_agreement.h"

namespace kinevox {
namespace {

constexpr double kBesidePart = 0.15;    // of the largest island's height: others so near belong to it
constexpr double kSmallestPart = 0.01;  // of its area
constexpr double kFewestPart = 0.0005;  // of the picture: less is nobody

// The largest island of `mask` and those beside it; empty where it is too small to be a person.
SilhouettePicture main_subject(const std::vector<std::uint8_t>& mask, int width, int height) {
    const cv::Mat picture(height, width, CV_8U, const_cast<std::uint8_t*>(mask.data()));
    cv::Mat labels, boxes, centres;
    const int count = cv::connectedComponentsWithStats(picture, labels, boxes, centres, 8, CV_32S);
    int largest = 0;
    for (int i = 1; i < count; ++i)
        if (largest == 0 || boxes.at<int>(i, cv::CC_STAT_AREA) > boxes.at<int>(largest, cv::CC_STAT_AREA))
            largest = i;
    SilhouettePicture out;
    if (largest == 0 || boxes.at<int>(largest, cv::CC_STAT_AREA) < kFewestPart * width * height) return out;
    const auto box = [&](int i) {
        return cv::Rect(boxes.at<int>(i, cv::CC_STAT_LEFT), boxes.at<int>(i, cv::CC_STAT_TOP),
                        boxes.at<int>(i, cv::CC_STAT_WIDTH), boxes.at<int>(i, cv::CC_STAT_HEIGHT));
    };
    cv::Rect near = box(largest);
    const int margin = static_cast<int>(kBesidePart * std::max(near.height, near.width));
    near += cv::Point(-margin, -margin);
    near += cv::Size(2 * margin, 2 * margin);
    std::vector<std::uint8_t> keep(count, 0);
    for (int i = 1; i < count; ++i)
        keep[i] = (box(i) & near).area() > 0 && boxes.at<int>(i, cv::CC_STAT_AREA) >
                                                    kSmallestPart * boxes.at<int>(largest, cv::CC_STAT_AREA);
    out.mask.resize(mask.size());
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const bool set = keep[labels.at<int>(y, x)] != 0;
            out.mask[static_cast<std::size_t>(y) * width + x] = set ? 255 : 0;
            out.cut = out.cut || (set && (x == 0 || y == 0 || x == width - 1 || y == height - 1));
        }
    return out;
}

void judge(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes, std::optional<double> height_m,
           Certificate& certificate) {
    const auto extent = subject_extent(cameras, silhouettes);
    if (extent) certificate.subject_height_m = extent->highest_m - extent->lowest_m;
    certificate.world_is_set = true;
    for (Finding& finding : check_world(cameras, extent, height_m)) certificate.findings.push_back(std::move(finding));
}

}  // namespace

std::vector<SilhouettePicture> silhouettes_of(const FrameResult& result, const std::vector<Camera>& cameras) {
    std::vector<SilhouettePicture> pictures(cameras.size());
    oneapi::tbb::parallel_for(std::size_t{0}, std::min(cameras.size(), result.silhouettes.size()), [&](std::size_t c) {
        const kernels::Silhouettes& seen = result.silhouettes[c];
        if (seen.sharp.empty()) return;
        const bool tracked = result.subject && result.subject->camera_used[c];
        const bool whole = seen.searched.x1 - seen.searched.x0 == cameras[c].width &&
                           seen.searched.y1 - seen.searched.y0 == cameras[c].height;
        if (tracked || whole) pictures[c] = main_subject(seen.sharp, cameras[c].width, cameras[c].height);
    });
    return pictures;
}

absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int moments,
                                                    std::optional<double> height_m, const SolveProgress& progress) {
    PersonRefinement out;
    Certificate& certificate = out.certificate;
    certificate.made_by = "person";
    certificate.hull_before = certificate.hull = hull_agreement(cameras, silhouettes);
    certificate.cameras = cameras;
    // How far the cameras may be from where they are believed to be is not known: what the hull agrees with
    // best is taken.
    for (const auto& [angle_deg, shift_m] : {std::pair{0.25, 0.02}, std::pair{1.0, 0.07}, std::pair{5.0, 0.35}}) {
        SilhouetteRefineOptions options;
        options.most_moments = moments;
        options.prior_angle_deg = angle_deg, options.prior_shift_m = shift_m;
        auto refined = refine_from_silhouettes(cameras, silhouettes, options, progress);
        if (!refined.ok()) return refined.status();
        const HullAgreement hull = hull_agreement(refined->cameras, silhouettes);
        if (!(hull.mean_iou > certificate.hull->mean_iou)) continue;
        certificate.hull = hull;
        certificate.cameras = refined->cameras;
        out.better = *std::move(refined);
    }
    if (!out.better)
        certificate.findings.push_back(
            {Verdict::kCare, "unchanged", "", "the silhouettes fit no other places better: nothing was changed",
             "if it should be better, record a person who walks through the whole space"});
    judge(certificate.cameras, silhouettes, height_m, certificate);
    return out;
}

}  // namespace kinevox
