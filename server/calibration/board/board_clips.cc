#include "server/calibration/board/board_clips.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <memory>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <set>

#include "common/session_file.h"
#include "server/cameras/image_file.h"
#include "server/cameras/image_reader.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

// Size of the first image; 0 if there is none.
cv::Size size_of(const fs::path& file) {
    if (fs::is_directory(file)) {
        std::set<fs::path> files;
        for (const auto& entry : fs::directory_iterator(file))
            if (entry.is_regular_file()) files.insert(entry.path());
        for (const fs::path& one : files)
            if (const cv::Mat image = read_image_file(one, cv::IMREAD_COLOR); !image.empty())
                return image.size();
        return {};
    }
    if (const cv::Mat image = read_image_file(file, cv::IMREAD_COLOR); !image.empty()) return image.size();
    cv::VideoCapture video(file.string());
    cv::Mat image;
    return video.isOpened() && video.read(image) ? image.size() : cv::Size();
}

}  // namespace

bool is_session(const std::vector<std::string>& arguments) {
    return arguments.size() == 1 && arguments[0].ends_with(".toml") &&
           arguments[0].find('=') == std::string::npos;
}

absl::StatusOr<std::vector<CameraClip>> open_clips(const std::vector<std::string>& arguments) {
    std::vector<CameraClip> clips;
    if (is_session(arguments)) {
        const auto session = read_session(arguments[0]);
        if (!session.ok()) return session.status();
        const std::vector<std::int64_t> first = first_image_indices(*session);
        for (const SessionCamera& camera : session->cameras)
            clips.push_back({camera.name, camera.video, camera.background, 0, 0, first[clips.size()]});
    } else {
        for (const std::string& argument : arguments) {
            const std::size_t equals = argument.find('=');
            CameraClip clip;
            clip.file = equals == std::string::npos ? argument : argument.substr(equals + 1);
            clip.camera =
                equals == std::string::npos ? clip.file.stem().string() : argument.substr(0, equals);
            if (const std::string problem = camera_name_problem(clip.camera); !problem.empty())
                return absl::InvalidArgumentError(
                    fmt::format("'{}': the camera's name {}", argument, problem));
            for (const CameraClip& other : clips)
                if (other.camera == clip.camera)
                    return absl::InvalidArgumentError(fmt::format(
                        "camera {} is given twice; write NAME=FILE with a name for each", clip.camera));
            clips.push_back(clip);
        }
    }
    for (CameraClip& clip : clips) {
        std::error_code error;
        if (!fs::exists(clip.file, error))
            return absl::NotFoundError(fmt::format("camera {}: {} does not exist; correct the path",
                                                   clip.camera, clip.file.string()));
        const cv::Size size = size_of(clip.file);
        if (size.area() == 0)
            return absl::InvalidArgumentError(
                fmt::format("camera {}: {} contains no readable image; give a video or a folder of images",
                            clip.camera, clip.file.string()));
        clip.width = size.width, clip.height = size.height;
    }
    return clips;
}

absl::Status read_side_by_side(
    const std::vector<CameraClip>& clips, const ClipImages& which, const std::string& what,
    const SolveProgress& progress,
    const std::function<absl::StatusOr<std::function<void(const Image&)>>(std::size_t, const Camera&)>&
        start) {
    std::mutex mutex;
    absl::Status status;
    std::atomic<std::int64_t> done{0}, total{0};
    std::atomic<bool> stop{false};
    const auto fail = [&](absl::Status why) {
        const std::scoped_lock lock(mutex);
        if (status.ok()) status = std::move(why);
        stop = true;
    };
    oneapi::tbb::parallel_for(std::size_t{0}, clips.size(), [&](std::size_t c) {
        Camera size;
        size.name = clips[c].camera, size.width = clips[c].width, size.height = clips[c].height;
        auto reader = open_images(clips[c].file, size);
        if (!reader.ok()) return fail(reader.status());
        if (clips[c].first > 0)
            if (absl::Status there = (*reader)->seek(clips[c].first); !there.ok()) return fail(there);
        auto see = start(c, size);
        if (!see.ok()) return fail(see.status());
        const std::int64_t end = which.max_count < 0
                                     ? std::numeric_limits<std::int64_t>::max()
                                     : which.first + std::int64_t{which.stride} * (which.max_count - 1) + 1;
        total += std::max<std::int64_t>(std::min((*reader)->promised() - clips[c].first, end), 1);
        for (std::int64_t frame = 0; frame < end && !stop; ++frame) {
            auto image = (*reader)->next();
            if (absl::IsOutOfRange(image.status())) break;
            if (!image.ok()) return fail(image.status());
            ++done;
            if (frame < which.first || (frame - which.first) % which.stride != 0) continue;
            (*see)(*image);
            const std::scoped_lock lock(mutex);
            const double fraction = std::min(
                1.0, static_cast<double>(done) / static_cast<double>(std::max(total.load(), done.load())));
            if (progress && !progress(fraction, fmt::format("{}, {} images", what, done.load())))
                status = absl::CancelledError("stopped; nothing was written"), stop = true;
        }
    });
    return status;
}

absl::StatusOr<std::vector<std::vector<BoardDetection>>> detect_boards(const std::vector<CameraClip>& clips,
                                                                       const BoardSpec& board,
                                                                       const ClipImages& which,
                                                                       const SolveProgress& progress) {
    return for_images<BoardDetection>(
        clips, which, "detecting the board", progress,
        [&](const CameraClip&, const Camera&) -> absl::StatusOr<Search<BoardDetection>> {
            auto detector = BoardDetector::create(board);
            if (!detector.ok()) return detector.status();
            return [detector = std::shared_ptr<BoardDetector>(*std::move(detector))](const Image& image) {
                return detector->detect(image);
            };
        });
}

}  // namespace kinevox
