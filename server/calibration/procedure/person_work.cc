// Refined extrinsics from the silhouettes of the captured person.
#include <fmt/format.h>

#include <algorithm>
#include <deque>

#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/coverage.h"
#include "server/calibration/person/session_silhouettes.h"
#include "server/calibration/procedure/procedure_kinds.h"

namespace kinevox {
namespace {

constexpr int kFrameSets = 48;                             // used
constexpr std::size_t kMaxBytes = std::size_t{256} << 20;  // of stored silhouettes
constexpr int kMinSolvableFrameSets = 12;                  // minimum for a solve
constexpr double kApart_s = 0.25;                          // of capture time, so that the person has moved
constexpr double kEnoughCoverage = 0.25;                   // of an image; people do not fill the ceiling

class PersonWork final : public ProcedureWork {
  public:
    PersonWork(std::vector<Camera> cameras, double height_m)
        : cameras_(std::move(cameras)), height_m_(height_m) {
        std::size_t bytes = 0;
        for (const Camera& camera : cameras_) {
            bytes += static_cast<std::size_t>(camera.width) * camera.height;
            coverage_.emplace_back(camera.width, camera.height);
            seen_.emplace_back().name = camera.name;
        }
        max_frame_sets_ =
            std::clamp<std::size_t>(kMaxBytes / std::max<std::size_t>(bytes, 1), 8, 2 * kFrameSets);
    }

    // The latest frame sets are kept: they show the current poses.
    bool observe(const FrameResult& result, LiveStep) override {
        const bool first = !last_ns_ || result.capture_time_ns < *last_ns_;  // a replay restarted
        if (!first && 1e-9 * static_cast<double>(result.capture_time_ns - *last_ns_) < kApart_s) return false;
        last_ns_ = result.capture_time_ns;
        add(silhouettes_of(result, cameras_));
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (!files.clips.empty() || files.board_on_floor_frame)
            return absl::InvalidArgumentError(
                "refining uses silhouettes: give a session with a person, no clips");
        if (!files.session_path.is_absolute())
            return absl::InvalidArgumentError(
                fmt::format("'{}' is not an absolute path; give the full path on the server",
                            files.session_path.string()));
        std::error_code error;
        if (!std::filesystem::exists(files.session_path, error))
            return absl::NotFoundError(
                fmt::format("{} does not exist; correct the path", files.session_path.string()));
        return absl::OkStatus();
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        auto read = session_silhouettes(files.session_path, kFrameSets, std::string(), progress);
        if (!read.ok()) return read.status();
        std::vector<std::size_t> index;  // of each camera in the session
        for (const Camera& camera : cameras_) {
            const Camera* const there = camera_named(read->cameras, camera.name);
            if (!there || there->width != camera.width || there->height != camera.height)
                return absl::InvalidArgumentError(
                    fmt::format("{} has no camera {} of {} x {} px; give a session of this daemon's cameras",
                                files.session_path.string(), camera.name, camera.width, camera.height));
            index.push_back(static_cast<std::size_t>(there - read->cameras.data()));
        }
        for (auto& frame_set : read->set.frame_sets) {
            std::vector<SilhouetteMask> images;
            for (const std::size_t i : index) images.push_back(std::move(frame_set[i]));
            add(std::move(images));
        }
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.cameras = seen_;
        report.shared_frame_set_count = static_cast<int>(frame_sets_.size());
        report.sufficient =
            report.shared_frame_set_count >= std::min<int>(kFrameSets, static_cast<int>(max_frame_sets_));
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            report.cameras[c].coverage = coverage_[c].fraction();
            report.cameras[c].coverage_counts = coverage_[c].counts();
            if (seen_[c].accepted_count == 0)
                report.hints.push_back(
                    fmt::format("camera {} has not detected the person", cameras_[c].name));
            else if (coverage_[c].fraction() < kEnoughCoverage)
                report.hints.push_back(fmt::format("camera {}: walk also through {} of the image",
                                                   cameras_[c].name, coverage_[c].emptiest()));
        }
        if (report.shared_frame_set_count < kMinSolvableFrameSets)
            report.hints.push_back(fmt::format("{} of {} frame sets; walk through the whole space",
                                               report.shared_frame_set_count, kMinSolvableFrameSets));
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        SilhouetteSet set;
        set.frame_sets.assign(frame_sets_.begin(), frame_sets_.end());
        auto refined = refine_from_person(cameras_, set, kFrameSets,
                                          height_m_ > 0 ? std::optional(height_m_) : std::nullopt, progress);
        if (!refined.ok()) return refined.status();
        return std::move(refined->certificate);
    }

  private:
    void add(std::vector<SilhouetteMask> images) {
        int seen_by = 0;
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            CameraObservations& seen = seen_[c];
            ++seen.image_count;
            seen.detected_in_latest = !images[c].empty();
            if (images[c].empty()) {
                reject_view(seen, "not_found", "");
                continue;
            }
            ++seen.accepted_count;
            ++seen_by;
            cover(images[c], c);
        }
        if (seen_by < 2) return;
        frame_sets_.push_back(std::move(images));
        if (frame_sets_.size() > max_frame_sets_) frame_sets_.pop_front();
    }

    void cover(const SilhouetteMask& image, std::size_t c) {
        const int width = cameras_[c].width, step = std::max(1, width / (4 * Coverage::kColumns));
        for (int y = 0; y < cameras_[c].height; y += step)
            for (int x = 0; x < width; x += step)
                if (image.mask[static_cast<std::size_t>(y) * width + x])
                    coverage_[c].add({static_cast<double>(x), static_cast<double>(y)});
    }

    std::vector<Camera> cameras_;
    double height_m_;
    std::size_t max_frame_sets_ = 0;
    std::deque<std::vector<SilhouetteMask>> frame_sets_;
    std::vector<CameraObservations> seen_;
    std::vector<Coverage> coverage_;
    std::optional<std::int64_t> last_ns_;
};

}  // namespace

ProcedureWorkOr make_person_work(const ProcedureRequest& request, const std::vector<Camera>& cameras) {
    if (request.stature_m != 0 && !(request.stature_m >= 0.5 && request.stature_m <= 2.6))
        return absl::InvalidArgumentError(
            fmt::format("stature_m is {}; 0.5 to 2.6 is allowed, or 0 if unknown", request.stature_m));
    return std::make_unique<PersonWork>(cameras, request.stature_m);
}

}  // namespace kinevox
