#include "server/recording/overlay_film.h"

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
#include "common/session_offsets.h"
#include "common/skeleton.h"
#include "server/cameras/h264_file.h"
#include "server/cameras/recorded_session.h"
#include "server/cameras/recorded_video.h"

namespace kinevox {
namespace {

constexpr int kMaxByDefault_px = 1280;
constexpr double kLineWidth = 1.0 / 200;  // of a tile's height
constexpr int kFilmQuality = 20;
constexpr double kRoomGrey = 28, kPersonGrey = 112;  // where silhouettes are shown

// B G R: the middle white, the left side blue, the right orange, as in reports.
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

// One camera's place in the film.
struct Tile {
    Camera camera;
    std::unique_ptr<PictureReader> pictures;
    std::int64_t first = 0;  // the picture that belongs to frame 0
    std::int64_t at = 0;     // what pictures->next() delivers
    cv::Rect place;          // px, in the film
    cv::Mat picture;         // as it was read last
};

void draw_skeleton(const Tile& tile, const std::array<Vec3, kJointNames.size()>& joints, cv::Mat& film) {
    cv::Mat canvas = film(tile.place);
    constexpr int kShift = 4;  // sixteenths of a pixel
    const double scale = static_cast<double>(tile.place.width) / tile.camera.width;
    const int thickness = std::max(1, static_cast<int>(std::lround(kLineWidth * tile.place.height)));
    std::array<std::optional<cv::Point>, kJointNames.size()> points;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        if (std::isnan(joints[j].x)) continue;
        const auto pixel = tile.camera.project(joints[j]);
        if (!pixel || !(std::abs(pixel->x) < 1e5) || !(std::abs(pixel->y) < 1e5)) continue;
        const auto to_film = [&](double value) {  // pixels' centres are whole numbers in both
            return static_cast<int>(std::lround(((value + 0.5) * scale - 0.5) * (1 << kShift)));
        };
        points[j] = cv::Point(to_film(pixel->x), to_film(pixel->y));
    }
    for (const Bone& bone : kBones) {
        const auto &from = points[*joint_index(bone.from)], &to = points[*joint_index(bone.to)];
        if (from && to) cv::line(canvas, *from, *to, colour_of(bone.side), thickness, cv::LINE_AA, kShift);
    }
    for (const auto& point : points)
        if (point) cv::circle(canvas, *point, thickness << kShift, {0, 0, 0}, -1, cv::LINE_AA, kShift);
}

absl::StatusOr<std::vector<Tile>> open_tiles(const Session& session, const std::string& wanted) {
    const auto cameras = read_session_cameras(session);
    if (!cameras.ok()) return cameras.status();
    const std::vector<std::int64_t> first = first_pictures(session);
    std::vector<Tile> tiles;
    std::vector<std::string> names;
    for (std::size_t c = 0; c < cameras->size(); ++c) {
        names.push_back((*cameras)[c].name);
        if (!wanted.empty() && (*cameras)[c].name != wanted) continue;
        auto pictures = open_pictures(session.cameras[c].video, (*cameras)[c]);
        if (!pictures.ok()) return pictures.status();
        Tile& tile = tiles.emplace_back();
        tile.camera = (*cameras)[c];
        tile.first = first[c];
        tile.pictures = *std::move(pictures);
    }
    if (tiles.empty())
        return absl::NotFoundError(fmt::format("session \"{}\" has no camera \"{}\"; it has {}", session.name,
                                               wanted, fmt::join(names, ", ")));
    return tiles;
}

// The film's size, even as H.264 wants it; tiles in rows, each as large as the largest picture scaled.
cv::Size place_tiles(std::vector<Tile>& tiles, int width_px) {
    const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(tiles.size()))));
    const int rows = (static_cast<int>(tiles.size()) + columns - 1) / columns;
    int width = 0;
    double tallest = 0;  // over wide
    for (const Tile& tile : tiles) {
        width = std::max(width, tile.camera.width);
        tallest = std::max(tallest, static_cast<double>(tile.camera.height) / tile.camera.width);
    }
    const int film_width = width_px > 0 ? width_px : std::min(columns * width, kMaxByDefault_px);
    const int tile_width = std::max(film_width / columns / 2 * 2, 2);
    const int tile_height = std::max(static_cast<int>(tallest * tile_width) / 2 * 2, 2);
    for (std::size_t t = 0; t < tiles.size(); ++t) {
        const Camera& camera = tiles[t].camera;
        const int height = std::min(tile_height, tile_width * camera.height / camera.width);
        tiles[t].place = {static_cast<int>(t) % columns * tile_width,
                          static_cast<int>(t) / columns * tile_height, tile_width, std::max(height, 1)};
    }
    return {columns * tile_width, rows * tile_height};
}

// The picture of frame set `frame_set`, which is not before the one read last.
absl::Status read_picture(Tile& tile, std::int64_t frame_set) {
    const std::int64_t frame = tile.first + frame_set;
    if (auto* video = dynamic_cast<RecordedVideo*>(tile.pictures.get()); video && tile.at < frame) {
        if (absl::Status there = video->seek(frame); !there.ok()) return there;
        tile.at = frame;
    }
    for (; tile.at <= frame; ++tile.at) {
        auto picture = tile.pictures->next();
        if (!picture.ok()) return picture.status();
        if (tile.at < frame) continue;
        if (picture->empty())  // the camera was silent
            tile.picture = cv::Mat(tile.camera.height, tile.camera.width, CV_8UC3, cv::Scalar::all(0));
        else
            tile.picture = cv::Mat(picture->height, picture->width, CV_8UC3,
                                   const_cast<std::uint8_t*>(picture->data.get()))
                               .clone();
    }
    return absl::OkStatus();
}

}  // namespace

absl::Status write_overlay_film(const Session& session, const Trial& trial, const OverlayOptions& options,
                                const std::filesystem::path& file, const LongWork& work) {
    auto tiles = open_tiles(session, options.camera);
    if (!tiles.ok()) return tiles.status();
    const cv::Size size = place_tiles(*tiles, options.width_px);
    auto film = H264File::create(file, size.width, size.height, {trial.rate_hz, kFilmQuality});
    if (!film.ok()) return film.status();
    for (std::size_t n = 0; n < trial.size(); ++n) {
        if (work.stop) return absl::CancelledError("the film was stopped");
        const std::size_t bytes = static_cast<std::size_t>(size.area()) * 3;
        std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]());
        cv::Mat canvas(size, CV_8UC3, data.get());
        for (Tile& tile : *tiles) {
            if (trial.pictures[n] >= 0)
                if (absl::Status read = read_picture(tile, trial.pictures[n]); !read.ok()) return read;
            if (!tile.picture.empty())
                cv::resize(tile.picture, canvas(tile.place), tile.place.size(), 0, 0, cv::INTER_AREA);
            if (options.silhouettes) {
                cv::Mat shown = canvas(tile.place);
                shown.convertTo(shown, -1, (kPersonGrey - kRoomGrey) / 255, kRoomGrey);
            }
            draw_skeleton(tile, trial.joints[n], canvas);
            if (tiles->size() > 1)
                cv::putText(canvas(tile.place), tile.camera.name, {6, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.5,
                            {255, 255, 255}, 1, cv::LINE_AA);
        }
        if (absl::Status written = (*film)->write({size.width, size.height, 3, std::move(data)});
            !written.ok())
            return written;
        work.tell(static_cast<double>(n + 1) / static_cast<double>(trial.size()));
    }
    return (*film)->close();
}

}  // namespace kinevox
