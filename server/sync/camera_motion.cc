#include "server/sync/camera_motion.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "kernels/segmentation.h"
#include "server/cameras/picture_reader.h"
#include "server/cameras/session_files.h"
#include "server/pipeline/main_subject.h"

namespace kinevox::sync {
namespace {

cv::Mat smaller(const Picture& picture, int factor) {
    const cv::Mat full(picture.height, picture.width, CV_8UC(picture.channels),
                       const_cast<std::uint8_t*>(picture.data.get()));
    if (factor == 1) return full;
    const cv::Size size(picture.width / factor, picture.height / factor);
    cv::Mat small;  // exactly that factor: what remains of an edge is left out
    cv::resize(full(cv::Rect(0, 0, size.width * factor, size.height * factor)), small, size, 0, 0,
               cv::INTER_AREA);
    return small;
}

kernels::PictureView view_of(const cv::Mat& picture) {
    return {picture.data, picture.cols, picture.rows, picture.channels(),
            static_cast<std::ptrdiff_t>(picture.step)};
}

// `factor`: of the full picture's pixels make one of the mask's.
SeenShape shape_of(const cv::Mat& mask, int factor) {
    SeenShape out;
    out.seen = true;
    const double scale = factor;
    const auto full = [&](double pixel) { return (pixel + 0.5) * scale - 0.5; };
    double sum = 0, sum_x = 0, sum_y = 0;
    int top = -1, bottom = -1;
    // The ends of each row's pixels, by their outer edges, hold all that is convex.
    std::vector<cv::Point2f> ends;
    for (int y = 0; y < mask.rows; ++y) {
        const std::uint8_t* const row = mask.ptr<std::uint8_t>(y);
        int left = -1, right = -1;
        double count = 0, moment = 0;
        for (int x = 0; x < mask.cols; ++x)
            if (row[x]) {
                if (left < 0) left = x;
                right = x;
                ++count, moment += x;
            }
        if (left < 0) continue;
        if (top < 0) top = y;
        bottom = y;
        sum += count, sum_x += moment, sum_y += count * y;
        const auto l = static_cast<float>(left), r = static_cast<float>(right), at = static_cast<float>(y);
        for (const cv::Point2f p :
             {cv::Point2f(l - 0.5f, at), cv::Point2f(r + 0.5f, at), cv::Point2f(l, at - 0.5f),
              cv::Point2f(r, at - 0.5f), cv::Point2f(l, at + 0.5f), cv::Point2f(r, at + 0.5f)})
            ends.push_back(p);
        out.cut_aside = out.cut_aside || left == 0 || right == mask.cols - 1;
    }
    out.cut_above = top == 0, out.cut_below = bottom == mask.rows - 1;
    out.area_px2 = sum * scale * scale;
    out.top_px = full(top - 0.5), out.bottom_px = full(bottom + 0.5);
    out.centroid_x_px = full(sum_x / sum), out.centroid_y_px = full(sum_y / sum);
    std::vector<cv::Point2f> hull;
    cv::convexHull(ends, hull);
    for (const cv::Point2f p : hull) {
        out.hull.push_back({full(p.x), full(p.y)});
        out.hull_at_border.push_back(p.x < 1 || p.y < 1 || p.x > static_cast<float>(mask.cols - 2) ||
                                     p.y > static_cast<float>(mask.rows - 2));
    }
    return out;
}

// Tells how far all cameras together are.
class Together {
  public:
    Together(const Progress& progress, std::int64_t total)
        : progress_(progress), total_(std::max<std::int64_t>(total, 1)) {}
    // False once anything wants it to end.
    bool one_more() {
        const std::scoped_lock lock(mutex_);
        ++done_;
        const double part = std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
        if (status_.ok() && progress_ && !progress_(part, fmt::format("silhouettes, {} pictures", done_)))
            status_ = absl::CancelledError("stopped; nothing was written");
        return status_.ok();
    }
    void fail(const absl::Status& status) {
        const std::scoped_lock lock(mutex_);
        if (status_.ok()) status_ = status;
    }
    absl::Status status() const { return status_; }

  private:
    const Progress& progress_;
    std::mutex mutex_;
    std::int64_t done_ = 0, total_;
    absl::Status status_;
};

absl::Status read_camera(PictureReader& reader, const std::vector<Picture>& background, int factor,
                         Together& together, CameraMotion& out) {
    std::vector<cv::Mat> empty_scene;
    std::vector<kernels::PictureView> views;
    for (const Picture& picture : background)
        views.push_back(view_of(empty_scene.emplace_back(smaller(picture, factor))));
    kernels::SegmentationOptions options;
    options.absorb_frames = 100'000'000;  // who stands still for long is still there
    const auto segmenter = kernels::make_segmenter(kernels::Device::kCpu, views[0].width, views[0].height,
                                                   views[0].channels, options);
    segmenter->learn(views);
    kernels::Silhouettes silhouettes;
    cv::Mat before;
    for (;;) {
        const auto picture = reader.next();
        if (absl::IsOutOfRange(picture.status())) return absl::OkStatus();
        if (!picture.ok()) return picture.status();
        SeenShape& shape = out.shapes.emplace_back();
        cv::Mat subject;
        if (!picture->empty()) {
            const cv::Mat small = smaller(*picture, factor);
            segmenter->segment(view_of(small), {}, silhouettes);
            std::vector<std::uint8_t> mask = main_subject(silhouettes.sharp, small.cols, small.rows);
            if (!mask.empty()) subject = cv::Mat(small.rows, small.cols, CV_8U, mask.data()).clone();
        }
        if (!subject.empty()) {
            shape = shape_of(subject, factor);
            shape.changed_px2 = std::numeric_limits<double>::quiet_NaN();
            if (!before.empty()) {
                cv::Mat differs;
                cv::bitwise_xor(subject, before, differs);
                shape.changed_px2 = cv::countNonZero(differs) * static_cast<double>(factor) * factor;
            }
        }
        before = subject;
        if (!together.one_more()) return absl::OkStatus();
    }
}

}  // namespace

absl::StatusOr<std::vector<CameraMotion>> read_motion(const Session& session,
                                                      const CameraMotionOptions& options,
                                                      const Progress& progress) {
    const auto cameras = read_session_cameras(session);
    if (!cameras.ok()) return cameras.status();
    const auto background = read_backgrounds(session, *cameras);
    if (!background.ok()) return background.status();
    if (absl::Status all = each_has_background(*background, *cameras, session.name); !all.ok()) return all;
    std::vector<std::unique_ptr<PictureReader>> readers;
    std::int64_t total = 0;
    for (std::size_t c = 0; c < cameras->size(); ++c) {
        auto reader = open_pictures(session.cameras[c].video, (*cameras)[c]);
        if (!reader.ok()) return reader.status();
        total += std::max<std::int64_t>((*reader)->promised(), 1);
        readers.push_back(*std::move(reader));
    }
    Together together(progress, total);
    std::vector<CameraMotion> out(cameras->size());
    oneapi::tbb::parallel_for(
        std::size_t{0}, out.size(),
        [&](std::size_t c) {
            out[c].camera = (*cameras)[c];
            const int longest = std::max((*cameras)[c].width, (*cameras)[c].height);
            int factor = 1;
            while (options.max_side_px > 0 && longest / factor > options.max_side_px) ++factor;
            if (absl::Status read = read_camera(*readers[c], (*background)[c], factor, together, out[c]);
                !read.ok())
                together.fail(read);
        },
        oneapi::tbb::simple_partitioner());
    if (!together.status().ok()) return together.status();
    return out;
}

}  // namespace kinevox::sync
