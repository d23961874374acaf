#include "server/sync/camera_motion.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <mutex>
#include <opencv2/imgproc.hpp>

#include "server/cameras/image_mat.h"
#include "server/cameras/image_reader.h"
#include "server/cameras/session_files.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox::sync {
namespace {

cv::Mat smaller(const Image& image, int factor) {
    const cv::Mat full = as_mat(image);
    if (factor == 1) return full;
    const cv::Size size(image.width / factor, image.height / factor);
    cv::Mat small;  // exactly that factor: a remainder at the edge is dropped
    cv::resize(full(cv::Rect(0, 0, size.width * factor, size.height * factor)), small, size, 0, 0,
               cv::INTER_AREA);
    return small;
}

kernels::ImageView view_of(const cv::Mat& image) {
    return {image.data, image.cols, image.rows, image.channels(), static_cast<std::ptrdiff_t>(image.step)};
}

// `factor`: full-resolution pixels per mask pixel.
SilhouetteShape shape_of(const cv::Mat& mask, int factor) {
    SilhouetteShape out;
    out.seen = true;
    const double scale = factor;
    const auto full = [&](double pixel) { return (pixel + 0.5) * scale - 0.5; };
    double sum = 0, sum_x = 0, sum_y = 0;
    int top = -1, bottom = -1;
    // The outer edges of each row's first and last pixel span the convex hull.
    std::vector<cv::Point2f> ends;
    for (int y = 0; y < mask.rows; ++y) {
        const std::uint8_t* const row = mask.ptr<std::uint8_t>(y);
        int left = -1, right = -1;
        double count = 0, x_sum = 0;
        for (int x = 0; x < mask.cols; ++x)
            if (row[x]) {
                if (left < 0) left = x;
                right = x;
                ++count, x_sum += x;
            }
        if (left < 0) continue;
        if (top < 0) top = y;
        bottom = y;
        sum += count, sum_x += x_sum, sum_y += count * y;
        const auto l = static_cast<float>(left), r = static_cast<float>(right), at = static_cast<float>(y);
        for (const cv::Point2f p :
             {cv::Point2f(l - 0.5f, at), cv::Point2f(r + 0.5f, at), cv::Point2f(l, at - 0.5f),
              cv::Point2f(r, at - 0.5f), cv::Point2f(l, at + 0.5f), cv::Point2f(r, at + 0.5f)})
            ends.push_back(p);
        out.truncated_sides = out.truncated_sides || left == 0 || right == mask.cols - 1;
    }
    out.truncated_top = top == 0, out.truncated_bottom = bottom == mask.rows - 1;
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

// Progress of all cameras together.
class ProgressCounter {
  public:
    ProgressCounter(const Progress& progress, std::int64_t total)
        : progress_(progress), total_(std::max<std::int64_t>(total, 1)) {}
    // False once reading should stop.
    bool one_more() {
        const std::scoped_lock lock(mutex_);
        ++done_;
        const double fraction = std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
        if (status_.ok() && progress_ && !progress_(fraction, fmt::format("silhouettes, {} images", done_)))
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

absl::Status read_camera(ImageReader& reader, const std::vector<Image>& background, int factor,
                         ProgressCounter& counter, CameraMotion& out) {
    std::vector<cv::Mat> background_images;
    std::vector<kernels::ImageView> views;
    for (const Image& image : background)
        views.push_back(view_of(background_images.emplace_back(smaller(image, factor))));
    kernels::SegmentationOptions options;
    options.absorb_frames = 100'000'000;  // a person who stands still is never absorbed
    SubjectSegmenter segmenter(views[0].width, views[0].height, views[0].channels, views, options);
    cv::Mat before;
    for (;;) {
        const auto image = reader.next();
        if (absl::IsOutOfRange(image.status())) return absl::OkStatus();
        if (!image.ok()) return image.status();
        SilhouetteShape& shape = out.shapes.emplace_back();
        cv::Mat subject;
        if (!image->empty()) {
            const cv::Mat small = smaller(*image, factor);
            std::vector<std::uint8_t> mask = segmenter.segment(view_of(small));
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
        if (!counter.one_more()) return absl::OkStatus();
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
    std::vector<std::unique_ptr<ImageReader>> readers;
    std::int64_t total = 0;
    for (std::size_t c = 0; c < cameras->size(); ++c) {
        auto reader = open_images(session.cameras[c].video, (*cameras)[c]);
        if (!reader.ok()) return reader.status();
        total += std::max<std::int64_t>((*reader)->promised(), 1);
        readers.push_back(*std::move(reader));
    }
    ProgressCounter counter(progress, total);
    std::vector<CameraMotion> out(cameras->size());
    oneapi::tbb::parallel_for(
        std::size_t{0}, out.size(),
        [&](std::size_t c) {
            out[c].camera = (*cameras)[c];
            const int longer_side = std::max((*cameras)[c].width, (*cameras)[c].height);
            int factor = 1;
            while (options.max_side_px > 0 && longer_side / factor > options.max_side_px) ++factor;
            if (absl::Status read = read_camera(*readers[c], (*background)[c], factor, counter, out[c]);
                !read.ok())
                counter.fail(read);
        },
        oneapi::tbb::simple_partitioner());
    if (!counter.status().ok()) return counter.status();
    return out;
}

}  // namespace kinevox::sync
