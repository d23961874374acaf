#include "server/calibration/person/session_silhouettes.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/cameras/session_source.h"
#include "server/pipeline/pipeline.h"
#include "server/silhouettes/silhouettes.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {
namespace {

constexpr double kVoxel_m = 0.02;         // of the volume that predicts the next image's foreground
constexpr double kTrackedPerSecond = 15;  // frame sets

SilhouetteMask with_truncation(std::vector<std::uint8_t> mask, int width, int height) {
    SilhouetteMask out;
    out.mask = std::move(mask);
    if (out.mask.empty()) return out;
    const auto row = [&](int y) { return out.mask.begin() + static_cast<std::ptrdiff_t>(y) * width; };
    const auto any = [](auto begin, auto end) { return std::find(begin, end, 255) != end; };
    out.truncated = any(row(0), row(1)) || any(row(height - 1), row(height));
    for (int y = 0; y < height; ++y) out.truncated = out.truncated || row(y)[0] || row(y)[width - 1];
    return out;
}

struct OpenSession {
    std::unique_ptr<FrameSource> source;
    std::vector<std::vector<Image>> background;
};

absl::StatusOr<OpenSession> open_session(const std::filesystem::path& session_file) {
    auto source = open_session_source(session_file);
    if (!source.ok()) return source.status();
    const std::vector<Camera>& cameras = (*source)->cameras();
    if (cameras.size() < 2)
        return absl::FailedPreconditionError(
            fmt::format("{}: has one camera; extrinsics need at least two", session_file.string()));
    auto background = background_of_all(**source, session_file);
    if (!background.ok()) return background.status();
    return OpenSession{*std::move(source), *std::move(background)};
}

// Calls `see(set, due)` with every `stride`-th frame set; about `frame_sets` of them are due.
template <class See>
absl::Status walk_through(FrameSource& source, int frame_sets, bool all_between,
                          const SolveProgress& progress, See see) {
    const std::int64_t all = source.frame_count();
    const std::int64_t step = all > frame_sets ? all / frame_sets : 1;
    // The tracker needs small motion between its frame sets.
    const std::int64_t stride =
        all_between ? std::clamp<std::int64_t>(std::llround(source.fps() / kTrackedPerSecond), 1, step)
                    : step;
    std::int64_t due = 0;
    for (std::int64_t frame = 0;; ++frame) {
        auto set = source.next();
        if (absl::IsOutOfRange(set.status())) return absl::OkStatus();
        if (!set.ok()) return set.status();
        if (frame % stride != 0) continue;
        if (absl::Status seen = see(*std::move(set), frame >= due); !seen.ok()) return seen;
        if (frame >= due) due += step;
        const double fraction = all > 0 ? static_cast<double>(frame) / static_cast<double>(all) : 0.5;
        if (progress && !progress(fraction, fmt::format("silhouettes, frame {}", frame)))
            return absl::CancelledError("stopped; nothing was written");
    }
}

}  // namespace

std::vector<SilhouetteMask> silhouettes_of(const FrameResult& result, const std::vector<Camera>& cameras) {
    std::vector<SilhouetteMask> images(cameras.size());
    oneapi::tbb::parallel_for(
        std::size_t{0}, std::min(cameras.size(), result.silhouettes.size()), [&](std::size_t c) {
            const kernels::Silhouettes& seen = result.silhouettes[c];
            if (seen.sharp.empty()) return;
            const bool tracked = result.first_subject() && result.first_subject()->track.used_cameras[c];
            const bool whole = seen.searched.x1 - seen.searched.x0 == cameras[c].width &&
                               seen.searched.y1 - seen.searched.y0 == cameras[c].height;
            if (tracked || whole)
                images[c] = with_truncation(main_subject(seen.sharp, cameras[c].width, cameras[c].height),
                                            cameras[c].width, cameras[c].height);
        });
    return images;
}

absl::StatusOr<SilhouetteSet> tracked_silhouettes(const std::filesystem::path& session_file,
                                                  const std::vector<Camera>& cameras, int frame_sets,
                                                  const SolveProgress& progress) {
    auto session = open_session(session_file);
    if (!session.ok()) return session.status();
    PipelineOptions options;
    options.voxel_m = kVoxel_m;
    options.colouring = options.pose = false;
    auto pipeline = Pipeline::create(cameras, session->source->fps(), options);
    if (!pipeline.ok()) return pipeline.status();
    if (absl::Status learned = (*pipeline)->learn_background(session->background); !learned.ok())
        return absl::Status(learned.code(),
                            fmt::format("{}: {}", session_file.string(), std::string(learned.message())));
    SilhouetteSet out;
    const absl::Status walked = walk_through(
        *session->source, frame_sets, true, progress, [&](FrameSet set, bool due) -> absl::Status {
            const auto result = (*pipeline)->process(std::move(set));
            if (!result.ok()) return result.status();
            if (due) out.frame_sets.push_back(silhouettes_of(**result, cameras));
            return absl::OkStatus();
        });
    if (!walked.ok()) return walked;
    return out;
}

absl::StatusOr<SilhouetteSet> untracked_silhouettes(const std::filesystem::path& session_file, int frame_sets,
                                                    const SolveProgress& progress) {
    auto session = open_session(session_file);
    if (!session.ok()) return session.status();
    const std::vector<Camera>& cameras = session->source->cameras();
    kernels::SegmentationOptions options;
    options.update_interval = 0;  // the images are far apart in time
    std::vector<SubjectSegmenter> segmenters;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        std::vector<kernels::ImageView> views;
        for (const Image& image : session->background[c]) views.push_back(to_kernel(image));
        segmenters.emplace_back(cameras[c].width, cameras[c].height, 3, views, options);
    }
    SilhouetteSet out;
    const absl::Status walked =
        walk_through(*session->source, frame_sets, false, progress, [&](FrameSet set, bool) -> absl::Status {
            std::vector<SilhouetteMask> images(cameras.size());
            oneapi::tbb::parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
                if (set.images[c].empty()) return;
                images[c] = with_truncation(segmenters[c].segment(to_kernel(set.images[c])), cameras[c].width,
                                            cameras[c].height);
            });
            out.frame_sets.push_back(std::move(images));
            return absl::OkStatus();
        });
    if (!walked.ok()) return walked;
    return out;
}

absl::StatusOr<std::vector<Camera>> session_cameras(const std::filesystem::path& session_file,
                                                    const std::string& calibration_file) {
    const auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    auto cameras = read_session_cameras(*session);
    if (!cameras.ok() || calibration_file.empty()) return cameras;
    const auto other = read_calibration(calibration_file);
    if (!other.ok()) return other.status();
    for (Camera& camera : *cameras) {
        const Camera* const found = camera_named(*other, camera.name);
        if (!found || found->width != camera.width || found->height != camera.height)
            return absl::InvalidArgumentError(
                fmt::format("{}: has no camera {} of {} x {} px; give a calibration of the session's cameras",
                            calibration_file, camera.name, camera.width, camera.height));
        camera = *found;
    }
    return cameras;
}

absl::StatusOr<SessionSilhouettes> session_silhouettes(const std::filesystem::path& session_file,
                                                       int frame_sets, const std::string& calibration_file,
                                                       const SolveProgress& progress) {
    auto cameras = session_cameras(session_file, calibration_file);
    if (!cameras.ok()) return cameras.status();
    auto silhouettes = tracked_silhouettes(session_file, *cameras, frame_sets, progress);
    if (!silhouettes.ok()) return silhouettes.status();
    return SessionSilhouettes{*std::move(cameras), *std::move(silhouettes)};
}

}  // namespace kinevox
