#include "server/calibration/board_clips.h"

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
#include "common/session_offsets.h"
#include "server/cameras/picture_reader.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

// Width and height of the first picture; 0 where there is none.
cv::Size size_of(const fs::path& file) {
    if (fs::is_directory(file)) {
        std::set<fs::path> files;
        for (const auto& entry : fs::directory_iterator(file))
            if (entry.is_regular_file()) files.insert(entry.path());
        for (const fs::path& one : files)
            if (const cv::Mat picture = cv::imread(one.string()); !picture.empty()) return picture.size();
        return {};
    }
    if (const cv::Mat picture = cv::imread(file.string()); !picture.empty()) return picture.size();
    cv::VideoCapture video(file.string());
    cv::Mat picture;
    return video.isOpened() && video.read(picture) ? picture.size() : cv::Size();
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
        const std::vector<std::int64_t> first = first_pictures(*session);
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
            return absl::NotFoundError(
                fmt::format("camera {}: there is no file or folder {}; correct the path", clip.camera,
                            clip.file.string()));
        const cv::Size size = size_of(clip.file);
        if (size.area() == 0)
            return absl::InvalidArgumentError(
                fmt::format("camera {}: {} holds no readable picture; give a video or a folder of pictures",
                            clip.camera, clip.file.string()));
        clip.width = size.width, clip.height = size.height;
    }
    return clips;
}

absl::Status read_side_by_side(
    const std::vector<CameraClip>& clips, const ClipPictures& which, const std::string& what,
    const SolveProgress& progress,
    const std::function<absl::StatusOr<std::function<void(const Picture&)>>(std::size_t, const Camera&)>&
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
        auto reader = open_pictures(clips[c].file, size);
        if (!reader.ok()) return fail(reader.status());
        if (clips[c].first > 0)
            if (absl::Status there = (*reader)->seek(clips[c].first); !there.ok()) return fail(there);
        auto see = start(c, size);
        if (!see.ok()) return fail(see.status());
        const std::int64_t end = which.most < 0
                                     ? std::numeric_limits<std::int64_t>::max()
                                     : which.first + std::int64_t{which.every} * (which.most - 1) + 1;
        total += std::max<std::int64_t>(std::min((*reader)->promised() - clips[c].first, end), 1);
        for (std::int64_t frame = 0; frame < end && !stop; ++frame) {
            auto picture = (*reader)->next();
            if (absl::IsOutOfRange(picture.status())) break;
            if (!picture.ok()) return fail(picture.status());
            ++done;
            if (frame < which.first || (frame - which.first) % which.every != 0) continue;
            (*see)(*picture);
            const std::scoped_lock lock(mutex);
            const double part = std::min(
                1.0, static_cast<double>(done) / static_cast<double>(std::max(total.load(), done.load())));
            if (progress && !progress(part, fmt::format("{}, {} pictures", what, done.load())))
                status = absl::CancelledError("stopped; nothing was written"), stop = true;
        }
    });
    return status;
}

absl::StatusOr<std::vector<std::vector<BoardSighting>>> find_boards(const std::vector<CameraClip>& clips,
                                                                    const BoardSpec& board,
                                                                    const ClipPictures& which,
                                                                    const SolveProgress& progress) {
    return for_pictures<BoardSighting>(
        clips, which, "looking for the board", progress,
        [&](const CameraClip&, const Camera&) -> absl::StatusOr<Search<BoardSighting>> {
            auto detector = BoardDetector::create(board);
            if (!detector.ok()) return detector.status();
            return [detector = std::shared_ptr<BoardDetector>(*std::move(detector))](const Picture& picture) {
                return detector->detect(picture);
            };
        });
}

}  // namespace kinevox
