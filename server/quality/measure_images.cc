// What the images alone show: light, foreground that stays in place, contours of a background that is not
// empty, and silhouettes cut by the image border.
#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "server/quality/samples.h"

namespace kinevox::quality {
namespace {

constexpr double kMinEdge = 40;     // Sobel magnitude of an edge, grey levels: above noise and compression
constexpr double kEdgeRatio = 1.6;  // of the two images' edges at one point: the larger one has it
constexpr double kStillFraction = 0.8;   // of the frame sets in which a still pixel is foreground
constexpr double kMovingFraction = 0.4;  // at most, next to a still object's contour
constexpr int kRing_px = 5;              // width of that surrounding
constexpr double kMinStillPixels = 60;
constexpr double kMinSharpFraction = 0.6;  // of a still object's surrounding
constexpr int kMinMovingPixels = 100;
// A still part of the subject is attached to its moving parts; an object is not, in some of the frame sets.
constexpr double kMinDetachedFraction = 0.4, kAttachedAreaFraction = 0.05;

// Largest Sobel magnitude within one pixel.
cv::Mat edges_of(const cv::Mat& grey) {
    cv::Mat smooth, x, y, magnitude, out;
    cv::GaussianBlur(grey, smooth, cv::Size(3, 3), 0.8);
    cv::Sobel(smooth, x, CV_32F, 1, 0);
    cv::Sobel(smooth, y, CV_32F, 0, 1);
    cv::magnitude(x, y, magnitude);
    cv::dilate(magnitude, out, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(5, 5)));
    return out;
}

struct EdgeCount {
    int in_image = 0, in_background = 0;
    double background_fraction() const {
        const int all = in_image + in_background;
        return all > 0 ? static_cast<double>(in_background) / all : 0;
    }
};

cv::Rect widened(const cv::Rect& box, int by_px, const cv::Size& image) {
    return cv::Rect(box.x - by_px, box.y - by_px, box.width + 2 * by_px, box.height + 2 * by_px) &
           cv::Rect({0, 0}, image);
}

// Which of the two images has the edges along the contours of a mask, away from the image border.
EdgeCount count_edges(const cv::Mat& mask, const cv::Mat& grey, const cv::Mat& background_edges) {
    EdgeCount count;
    constexpr int kMargin_px = 6;  // more than the filters are wide
    const cv::Rect around = widened(cv::boundingRect(mask), kMargin_px, mask.size());
    if (around.empty()) return count;
    const cv::Mat image_edges = edges_of(grey(around));
    std::vector<std::vector<cv::Point>> contours;
    cv::findContours(mask(around).clone(), contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE, around.tl());
    for (const auto& contour : contours)
        for (const cv::Point& p : contour) {
            if (p.x < 3 || p.y < 3 || p.x > mask.cols - 4 || p.y > mask.rows - 4) continue;
            const float here = image_edges.at<float>(p - around.tl()), there = background_edges.at<float>(p);
            if (std::max(here, there) < kMinEdge) continue;
            count.in_image += here > kEdgeRatio * there;
            count.in_background += there > kEdgeRatio * here;
        }
    return count;
}

cv::Mat foreground_frequency(const Samples& seen, std::size_t camera) {
    cv::Mat sum = cv::Mat::zeros(seen.background[camera].size(), CV_32F);
    int count = 0;
    for (const Sample& sample : seen.samples) {
        if (sample.views[camera].grey.empty()) continue;
        cv::accumulate(sample.views[camera].foreground, sum);
        ++count;
    }
    return count > 0 ? cv::Mat(sum / (255.0 * count)) : sum;
}

cv::Mat median_of_samples(const Samples& seen, std::size_t camera) {
    constexpr std::size_t kImages = 15;
    std::vector<cv::Mat> images;
    const std::size_t step = std::max<std::size_t>(1, seen.samples.size() / kImages);
    for (std::size_t n = 0; n < seen.samples.size(); n += step)
        if (!seen.samples[n].views[camera].grey.empty()) images.push_back(seen.samples[n].views[camera].grey);
    return images.empty() ? seen.background[camera] : median_image(images);
}

// The connected components of a foreground.
struct Components {
    cv::Mat labels;         // CV_32S; 0: background
    std::vector<int> area;  // by label
};

// Of each frame set with an image.
std::vector<Components> components_of(const Samples& seen, std::size_t camera) {
    std::vector<Components> out;
    for (const Sample& sample : seen.samples) {
        if (sample.views[camera].grey.empty()) continue;
        Components& one = out.emplace_back();
        cv::Mat boxes, centres;
        const int count = cv::connectedComponentsWithStats(sample.views[camera].foreground, one.labels, boxes,
                                                           centres, 8, CV_32S);
        for (int i = 0; i < count; ++i) one.area.push_back(boxes.at<int>(i, cv::CC_STAT_AREA));
    }
    return out;
}

// Fraction of the frame sets in which the foreground components that hold `still` hardly exceed it. `still`:
// the part of the image from `corner` on, with a margin of 2 px around what is set.
double detached_fraction(const std::vector<Components>& frame_sets, const cv::Mat& still, cv::Point corner) {
    const double pixels = cv::countNonZero(still);
    int detached = 0;
    cv::Mat grown;
    cv::dilate(still, grown, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(5, 5)));
    for (const Components& components : frame_sets) {
        const cv::Mat labels = components.labels(cv::Rect(corner, still.size()));
        std::vector<char> touches(components.area.size(), 0);
        for (int y = 0; y < labels.rows; ++y)
            for (int x = 0; x < labels.cols; ++x)
                if (still.at<std::uint8_t>(y, x)) touches[labels.at<int>(y, x)] = 1;
        touches[0] = 0;
        int attached = 0;
        for (std::size_t i = 0; i < touches.size(); ++i)
            if (touches[i]) attached += components.area[i];
        for (int y = 0; y < labels.rows; ++y)
            for (int x = 0; x < labels.cols; ++x)
                attached -= grown.at<std::uint8_t>(y, x) && touches[labels.at<int>(y, x)];
        detached += attached < kAttachedAreaFraction * pixels;
    }
    return frame_sets.empty() ? 0 : static_cast<double>(detached) / static_cast<double>(frame_sets.size());
}

double median_moving_pixels(const Samples& seen, std::size_t camera, const cv::Mat& still) {
    std::vector<double> areas;
    for (const Sample& sample : seen.samples)
        if (!sample.views[camera].grey.empty())
            areas.push_back(cv::countNonZero(sample.views[camera].foreground & ~still));
    return quantile_or(areas, 0.5, 0);
}

}  // namespace

void measure_light(const Samples& seen, std::vector<CameraMeasurements>& out) {
    for (std::size_t c = 0; c < out.size(); ++c) {
        std::vector<double> levels, dark, saturated, foreground;
        for (const Sample& sample : seen.samples) {
            const View& view = sample.views[c];
            if (view.grey.empty()) continue;
            const auto pixels = static_cast<double>(view.grey.total());
            levels.push_back(cv::mean(view.grey)[0]);
            dark.push_back(cv::countNonZero(view.grey <= kDarkLevel) / pixels);
            saturated.push_back(cv::countNonZero(view.grey >= kSaturatedLevel) / pixels);
            foreground.push_back(cv::countNonZero(view.foreground) / pixels);
        }
        out[c].mean_level = quantile_or(levels, 0.5, out[c].mean_level);
        out[c].dark_fraction = quantile_or(dark, 0.5, 0);
        out[c].saturated_fraction = quantile_or(saturated, 0.5, 0);
        out[c].foreground_fraction = quantile_or(foreground, 0.5, 0);
    }
}

void measure_ghosts(const Samples& seen, std::vector<CameraMeasurements>& out) {
    for (std::size_t c = 0; c < out.size(); ++c) {
        const cv::Mat background = edges_of(seen.background[c]);
        EdgeCount all;
        for (const Sample& sample : seen.samples) {
            if (sample.views[c].grey.empty()) continue;
            const EdgeCount one = count_edges(sample.views[c].foreground, sample.views[c].grey, background);
            all.in_image += one.in_image, all.in_background += one.in_background;
        }
        out[c].ghost_contour_fraction = all.background_fraction();
    }
}

std::vector<cv::Mat> measure_still(const Samples& seen, std::vector<CameraMeasurements>& out) {
    std::vector<cv::Mat> masks;
    const cv::Mat ring_element =
        cv::getStructuringElement(cv::MORPH_ELLIPSE, cv::Size(2 * kRing_px + 1, 2 * kRing_px + 1));
    for (std::size_t c = 0; c < out.size(); ++c) {
        const cv::Mat frequency = foreground_frequency(seen, c);
        cv::Mat often = frequency >= kStillFraction, labels, boxes, centres;
        cv::Mat& still = masks.emplace_back(cv::Mat::zeros(often.size(), CV_8U));
        const int count = cv::connectedComponentsWithStats(often, labels, boxes, centres, 8, CV_32S);
        const cv::Mat seldom = frequency <= kMovingFraction;
        std::optional<std::vector<Components>> components;
        for (int i = 1; i < count; ++i) {
            if (boxes.at<int>(i, cv::CC_STAT_AREA) < kMinStillPixels) continue;
            const int* const box = boxes.ptr<int>(i);
            const cv::Rect around = widened({box[cv::CC_STAT_LEFT], box[cv::CC_STAT_TOP],
                                             box[cv::CC_STAT_WIDTH], box[cv::CC_STAT_HEIGHT]},
                                            kRing_px + 1, often.size());
            const cv::Mat one = labels(around) == i;
            cv::Mat inner, outer;
            cv::dilate(one, inner, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(3, 3)));
            cv::dilate(one, outer, ring_element);
            const cv::Mat ring = outer & ~inner;
            const double sharp = static_cast<double>(cv::countNonZero(ring & seldom(around))) /
                                 std::max(1, cv::countNonZero(ring));
            if (sharp < kMinSharpFraction) continue;
            if (!components) components = components_of(seen, c);
            if (detached_fraction(*components, one, around.tl()) >= kMinDetachedFraction)
                still(around) |= one;
        }
        const double moving = median_moving_pixels(seen, c, still);
        const int pixels = cv::countNonZero(still);
        if (pixels == 0 || moving < kMinMovingPixels) {
            still = cv::Scalar(0);  // nothing else moves: the subject itself stands still
            continue;
        }
        out[c].still_area_ratio = pixels / moving;
        out[c].still_in_background_fraction =
            count_edges(still, median_of_samples(seen, c), edges_of(seen.background[c]))
                .background_fraction();
        cv::dilate(still, still, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(5, 5)));
    }
    return masks;
}

SilhouetteSet subject_silhouettes(const Samples& seen, const std::vector<cv::Mat>& still) {
    SilhouetteSet out;
    for (const Sample& sample : seen.samples) {
        auto& images = out.frame_sets.emplace_back(seen.cameras.size());
        for (std::size_t c = 0; c < images.size(); ++c) {
            if (sample.views[c].grey.empty()) continue;
            const cv::Mat moving = sample.views[c].foreground & ~still[c];
            const int width = moving.cols, height = moving.rows;
            SilhouetteMask& image = images[c];
            image.mask = main_subject({moving.ptr<std::uint8_t>(), moving.total()}, width, height);
            if (image.empty()) continue;
            const auto at = [&](int x, int y) { return image.mask[static_cast<std::size_t>(y) * width + x]; };
            for (int x = 0; x < width; ++x)
                image.truncated = image.truncated || at(x, 0) || at(x, height - 1);
            for (int y = 0; y < height; ++y)
                image.truncated = image.truncated || at(0, y) || at(width - 1, y);
        }
    }
    return out;
}

void measure_view(const Samples& seen, const SilhouetteSet& subject, std::vector<CameraMeasurements>& out) {
    for (std::size_t c = 0; c < out.size(); ++c) {
        int images = 0, present = 0, truncated = 0;
        for (std::size_t n = 0; n < seen.samples.size(); ++n) {
            if (seen.samples[n].views[c].grey.empty()) continue;
            ++images;
            present += !subject.frame_sets[n][c].empty();
            truncated += subject.frame_sets[n][c].truncated;
        }
        if (images == 0) continue;
        out[c].seen_fraction = static_cast<double>(present) / images;
        out[c].truncated_fraction = static_cast<double>(truncated) / images;
    }
}

}  // namespace kinevox::quality
