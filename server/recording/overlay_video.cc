#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "common/body_pose.h"
#include "common/body_table.h"
#include "common/session_file.h"
#include "server/cameras/h264_file.h"
#include "server/cameras/image_mat.h"
#include "server/cameras/image_reader.h"
#include "server/cameras/session_files.h"
#include "server/recording/recording_export.h"

namespace kinevox {
namespace {

constexpr int kMaxDefaultWidth_px = 1280;
constexpr double kLineWidth = 1.0 / 200;                       // of a tile's height
constexpr int kCrf = 20;                                       // x264's
constexpr double kBackgroundGrey = 28, kSilhouetteGrey = 112;  // of silhouette videos

// B G R: midline white, left blue, right orange, as in reports.
cv::Scalar colour_of(BodySide side) {
    switch (side) {
        case BodySide::kLeft:
            return {255, 160, 60};
        case BodySide::kRight:
            return {0, 165, 255};
        case BodySide::kMiddle:
            break;
    }
    return {255, 255, 255};
}

// One camera's tile of the video.
struct Tile {
    Camera camera;
    std::unique_ptr<ImageReader> images;
    std::int64_t first = 0;  // index of the image of frame 0
    std::int64_t at = 0;     // index of the image that images->next() returns
    cv::Rect area;           // px, in the video
    cv::Mat image;           // the latest one read
};

// OpenCV's font has ASCII only.
std::string label_of(const Trial& trial) {
    const auto is_ascii = [](char c) { return c >= 0x20 && c < 0x7f; };
    if (std::ranges::all_of(trial.subject_name, is_ascii)) return trial.subject_name;
    return fmt::format("subject {}", trial.subject_id);
}

void draw_skeleton(const Tile& tile, const std::array<Vec3, kJointNames.size()>& joints,
                   const std::string& label, cv::Mat& video) {
    cv::Mat canvas = video(tile.area);
    constexpr int kShift = 4;  // sixteenths of a pixel
    const double scale = static_cast<double>(tile.area.width) / tile.camera.width;
    const int thickness = std::max(1, static_cast<int>(std::lround(kLineWidth * tile.area.height)));
    std::array<std::optional<cv::Point>, kJointNames.size()> points;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        if (std::isnan(joints[j].x)) continue;
        const auto pixel = tile.camera.project(joints[j]);
        if (!pixel || !(std::abs(pixel->x) < 1e5) || !(std::abs(pixel->y) < 1e5)) continue;
        const auto to_video = [&](double value) {  // pixel centres are integers in both
            return static_cast<int>(std::lround(((value + 0.5) * scale - 0.5) * (1 << kShift)));
        };
        points[j] = cv::Point(to_video(pixel->x), to_video(pixel->y));
    }
    for (const Bone& bone : kBones) {
        const auto &from = points[*joint_index(bone.from)], &to = points[*joint_index(bone.to)];
        if (from && to) cv::line(canvas, *from, *to, colour_of(bone.side), thickness, cv::LINE_AA, kShift);
    }
    for (const auto& point : points)
        if (point) cv::circle(canvas, *point, thickness << kShift, {0, 0, 0}, -1, cv::LINE_AA, kShift);
    const auto& head = points[*joint_index("head_top")];
    if (label.empty() || !head) return;
    const cv::Point at(head->x / (1 << kShift) + 4 * thickness, head->y / (1 << kShift));
    cv::putText(canvas, label, at, cv::FONT_HERSHEY_SIMPLEX, 0.5, {255, 255, 255}, 1, cv::LINE_AA);
}

absl::StatusOr<std::vector<Tile>> open_tiles(const Session& session, const std::string& wanted) {
    const auto cameras = read_session_cameras(session);
    if (!cameras.ok()) return cameras.status();
    const std::vector<std::int64_t> first = first_image_indices(session);
    std::vector<Tile> tiles;
    std::vector<std::string> names;
    for (std::size_t c = 0; c < cameras->size(); ++c) {
        names.push_back((*cameras)[c].name);
        if (!wanted.empty() && (*cameras)[c].name != wanted) continue;
        auto images = open_images(session.cameras[c].video, (*cameras)[c]);
        if (!images.ok()) return images.status();
        Tile& tile = tiles.emplace_back();
        tile.camera = (*cameras)[c];
        tile.first = first[c];
        tile.images = *std::move(images);
    }
    if (tiles.empty())
        return absl::NotFoundError(fmt::format("session \"{}\" has no camera \"{}\"; it has {}", session.name,
                                               wanted, fmt::join(names, ", ")));
    return tiles;
}

// The video's size, even for H.264; tiles in rows, each as large as the largest scaled image.
cv::Size lay_out_tiles(std::vector<Tile>& tiles, int width_px) {
    const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(tiles.size()))));
    const int rows = (static_cast<int>(tiles.size()) + columns - 1) / columns;
    int width = 0;
    double max_aspect = 0;  // height over width
    for (const Tile& tile : tiles) {
        width = std::max(width, tile.camera.width);
        max_aspect = std::max(max_aspect, static_cast<double>(tile.camera.height) / tile.camera.width);
    }
    const int video_width = width_px > 0 ? width_px : std::min(columns * width, kMaxDefaultWidth_px);
    const int tile_width = std::max(video_width / columns / 2 * 2, 2);
    const int tile_height = std::max(static_cast<int>(max_aspect * tile_width) / 2 * 2, 2);
    for (std::size_t t = 0; t < tiles.size(); ++t) {
        const Camera& camera = tiles[t].camera;
        const int height = std::min(tile_height, tile_width * camera.height / camera.width);
        tiles[t].area = {static_cast<int>(t) % columns * tile_width,
                         static_cast<int>(t) / columns * tile_height, tile_width, std::max(height, 1)};
    }
    return {columns * tile_width, rows * tile_height};
}

// Reads the image of frame set `frame_set`, which is not before the latest one read.
absl::Status read_image(Tile& tile, std::int64_t frame_set) {
    const std::int64_t frame = tile.first + frame_set;
    if (auto* video = dynamic_cast<RecordedVideo*>(tile.images.get()); video && tile.at < frame) {
        if (absl::Status there = video->seek(frame); !there.ok()) return there;
        tile.at = frame;
    }
    for (; tile.at <= frame; ++tile.at) {
        auto image = tile.images->next();
        if (!image.ok()) return image.status();
        if (tile.at < frame) continue;
        if (image->empty())  // the camera delivered no image
            tile.image = cv::Mat(tile.camera.height, tile.camera.width, CV_8UC3, cv::Scalar::all(0));
        else
            tile.image = as_mat(*image).clone();
    }
    return absl::OkStatus();
}

}  // namespace

absl::Status write_overlay_video(const Session& session, std::span<const Trial> trials,
                                 const OverlayOptions& options, const std::filesystem::path& file,
                                 const JobControl& work) {
    const Trial& trial = trials.front();  // all have the same frames
    auto tiles = open_tiles(session, options.camera);
    if (!tiles.ok()) return tiles.status();
    const cv::Size size = lay_out_tiles(*tiles, options.width_px);
    auto video = H264File::create(file, size.width, size.height, {trial.rate_hz, kCrf});
    if (!video.ok()) return video.status();
    std::size_t shown = 0;  // the latest frame that was not lost
    for (std::size_t n = 0; n < trial.size(); ++n) {
        if (trial.session_frames[n] >= 0) shown = n;
        if (work.stop) return absl::CancelledError("the export was stopped");
        const std::size_t bytes = static_cast<std::size_t>(size.area()) * 3;
        std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]());
        cv::Mat canvas(size, CV_8UC3, data.get());
        for (Tile& tile : *tiles) {
            if (shown == n && trial.session_frames[n] >= 0)
                if (absl::Status read = read_image(tile, trial.session_frames[n]); !read.ok()) return read;
            if (!tile.image.empty())
                cv::resize(tile.image, canvas(tile.area), tile.area.size(), 0, 0, cv::INTER_AREA);
            if (options.silhouettes) {
                cv::Mat shown = canvas(tile.area);
                shown.convertTo(shown, -1, (kSilhouetteGrey - kBackgroundGrey) / 255, kBackgroundGrey);
            }
            for (const Trial& each : trials) draw_skeleton(tile, each.joints[shown], label_of(each), canvas);
            if (tiles->size() > 1)
                cv::putText(canvas(tile.area), tile.camera.name, {6, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.5,
                            {255, 255, 255}, 1, cv::LINE_AA);
        }
        if (absl::Status written = (*video)->write({size.width, size.height, 3, std::move(data)});
            !written.ok())
            return written;
        work.report(static_cast<double>(n + 1) / static_cast<double>(trial.size()));
    }
    return (*video)->close();
}

}  // namespace kinevox
