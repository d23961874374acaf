#include "server/calibration/session_silhouettes.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "kernels/segmentation.h"
#include "server/cameras/session_source.h"
#include "server/pipeline/convert.h"

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

}  // namespace

absl::StatusOr<SessionSilhouettes> session_silhouettes(const std::filesystem::path& session_file, int moments,
                                                       const SolveProgress& progress) {
    auto source = open_session_source(session_file);
    if (!source.ok()) return source.status();
    SessionSilhouettes out;
    out.cameras = (*source)->cameras();
    const std::size_t count = out.cameras.size();
    if (count < 2)
        return absl::FailedPreconditionError(
            fmt::format("{}: has one camera; places need two or more", session_file.string()));
    auto background = (*source)->background();
    if (!background.ok()) return background.status();
    if (background->empty())
        return absl::InvalidArgumentError(fmt::format(
            "{}: no camera has a `background`; add a picture, a clip or a folder of the empty scene to each",
            session_file.string()));
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;
    kernels::SegmentationOptions options;
    options.update_interval = 0;  // frames are far apart
    for (const Camera& camera : out.cameras)
        segmenters.push_back(
            kernels::make_segmenter(kernels::Device::kCpu, camera.width, camera.height, 3, options));
    for (std::size_t c = 0; c < count; ++c)
        if ((*background)[c].empty())
            return absl::InvalidArgumentError(
                fmt::format("{}: camera {} has no `background`; add a picture of the empty scene",
                            session_file.string(), out.cameras[c].name));
    oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t c) {
        std::vector<kernels::PictureView> views;
        for (const Picture& picture : (*background)[c]) views.push_back(to_kernel(picture));
        segmenters[c]->learn(views);
    });
    const std::int64_t all = (*source)->frame_count();
    const std::int64_t step = all > moments ? all / moments : 1;
    for (std::int64_t frame = 0;; ++frame) {
        auto set = (*source)->next();
        if (absl::IsOutOfRange(set.status())) break;
        if (!set.ok()) return set.status();
        if (frame % step != 0) continue;
        std::vector<SilhouettePicture> pictures(count);
        oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t c) {
            if (set->pictures[c].empty()) return;
            kernels::Silhouettes silhouettes;
            segmenters[c]->segment(to_kernel(set->pictures[c]), {}, silhouettes);
            pictures[c] = main_subject(silhouettes.sharp, out.cameras[c].width, out.cameras[c].height);
        });
        out.set.moments.push_back(std::move(pictures));
        const double part = all > 0 ? static_cast<double>(frame) / static_cast<double>(all) : 0.5;
        if (progress && !progress(part, fmt::format("silhouettes, frame {}", frame)))
            return absl::CancelledError("stopped; nothing was written");
    }
    return out;
}

}  // namespace kinevox
