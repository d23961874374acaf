// Better places from the silhouettes of the person who is captured.
#include <fmt/format.h>

#include <algorithm>
#include <deque>

#include "server/calibration/coverage.h"
#include "server/calibration/person_refine.h"
#include "server/calibration/procedure_works.h"
#include "server/calibration/session_silhouettes.h"

namespace kinevox {
namespace {

constexpr int kMoments = 48;                               // that are used
constexpr std::size_t kMaxBytes = std::size_t{256} << 20;  // of silhouettes that are kept
constexpr int kMinMoments = 12;                            // that are worth solving
constexpr double kApart_s = 0.25;                          // of capture time, so that the person has moved
constexpr double kEnoughCoverage = 0.25;                   // of a picture; people do not fill the ceiling

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
        max_moments_ = std::clamp<std::size_t>(kMaxBytes / std::max<std::size_t>(bytes, 1), 8, 2 * kMoments);
    }

    // The newest moments are kept: what the cameras see now counts.
    bool observe(const FrameResult& result, Taking) override {
        const bool first = !last_ns_ || result.capture_time_ns < *last_ns_;  // a recording began anew
        if (!first && 1e-9 * static_cast<double>(result.capture_time_ns - *last_ns_) < kApart_s) return false;
        last_ns_ = result.capture_time_ns;
        add(silhouettes_of(result, cameras_));
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (!files.clips.empty() || files.floor_frame)
            return absl::InvalidArgumentError(
                "refining needs silhouettes: give a session with a person in it, no clips");
        if (!files.session.is_absolute())
            return absl::InvalidArgumentError(fmt::format(
                "'{}' is no absolute path; the daemon reads a session by its full name on its own machine",
                files.session.string()));
        std::error_code error;
        if (!std::filesystem::exists(files.session, error))
            return absl::NotFoundError(
                fmt::format("there is no file {}; correct the path", files.session.string()));
        return absl::OkStatus();
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        auto read = session_silhouettes(files.session, kMoments, std::string(), progress);
        if (!read.ok()) return read.status();
        std::vector<std::size_t> index;  // of each of our cameras in the session
        for (const Camera& camera : cameras_) {
            const Camera* const there = camera_named(read->cameras, camera.name);
            if (!there || there->width != camera.width || there->height != camera.height)
                return absl::InvalidArgumentError(
                    fmt::format("{} has no camera {} of {} x {} px; give a session of this daemon's cameras",
                                files.session.string(), camera.name, camera.width, camera.height));
            index.push_back(static_cast<std::size_t>(there - read->cameras.data()));
        }
        for (auto& moment : read->set.moments) {
            std::vector<SilhouettePicture> pictures;
            for (const std::size_t i : index) pictures.push_back(std::move(moment[i]));
            add(std::move(pictures));
        }
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.cameras = seen_;
        report.moments = static_cast<int>(moments_.size());
        report.complete = report.moments >= std::min<int>(kMoments, static_cast<int>(max_moments_));
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            report.cameras[c].coverage = coverage_[c].part();
            report.cameras[c].coverage_counts = coverage_[c].counts();
            if (seen_[c].accepted == 0)
                report.hints.push_back(fmt::format("camera {} has not seen the person", cameras_[c].name));
            else if (coverage_[c].part() < kEnoughCoverage)
                report.hints.push_back(fmt::format("camera {}: walk also through {} of the picture",
                                                   cameras_[c].name, coverage_[c].emptiest()));
        }
        if (report.moments < kMinMoments)
            report.hints.push_back(
                fmt::format("{} of {} moments; walk through the whole space", report.moments, kMinMoments));
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        SilhouetteSet set;
        set.moments.assign(moments_.begin(), moments_.end());
        auto refined = refine_from_person(cameras_, set, kMoments,
                                          height_m_ > 0 ? std::optional(height_m_) : std::nullopt, progress);
        if (!refined.ok()) return refined.status();
        return std::move(refined->certificate);
    }

  private:
    void add(std::vector<SilhouettePicture> pictures) {
        int seen_by = 0;
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            ObservedCamera& seen = seen_[c];
            ++seen.pictures;
            seen.seen_last = !pictures[c].empty();
            if (pictures[c].empty()) {
                reject_view(seen, "not found", "");
                continue;
            }
            ++seen.accepted;
            ++seen_by;
            cover(pictures[c], c);
        }
        if (seen_by < 2) return;
        moments_.push_back(std::move(pictures));
        if (moments_.size() > max_moments_) moments_.pop_front();
    }

    void cover(const SilhouettePicture& picture, std::size_t c) {
        const int width = cameras_[c].width, step = std::max(1, width / (4 * Coverage::kColumns));
        for (int y = 0; y < cameras_[c].height; y += step)
            for (int x = 0; x < width; x += step)
                if (picture.mask[static_cast<std::size_t>(y) * width + x])
                    coverage_[c].add({static_cast<double>(x), static_cast<double>(y)});
    }

    std::vector<Camera> cameras_;
    double height_m_;
    std::size_t max_moments_ = 0;
    std::deque<std::vector<SilhouettePicture>> moments_;
    std::vector<ObservedCamera> seen_;
    std::vector<Coverage> coverage_;
    std::optional<std::int64_t> last_ns_;
};

}  // namespace

MadeWork make_person_work(const ProcedureRequest& request, const std::vector<Camera>& cameras) {
    if (request.subject_height_m != 0 &&
        !(request.subject_height_m >= 0.5 && request.subject_height_m <= 2.6))
        return absl::InvalidArgumentError(
            fmt::format("subject_height_m is {}; 0.5 to 2.6 is allowed, or 0 where it is not known",
                        request.subject_height_m));
    return std::make_unique<PersonWork>(cameras, request.subject_height_m);
}

}  // namespace kinevox
