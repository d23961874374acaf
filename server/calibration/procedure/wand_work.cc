// Extrinsics from a moving wand.
#include <fmt/format.h>

#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/procedure/procedure_kinds.h"
#include "server/calibration/wand/wand.h"

namespace kinevox {
namespace {

class WandWork final : public TargetExtrinsicsWork {
  public:
    WandWork(const WandSpec& wand, const ExtrinsicsOptions& options, std::vector<Camera> cameras,
             std::vector<std::size_t> chosen)
        : TargetExtrinsicsWork(std::move(cameras), std::move(chosen)),
          wand_(wand),
          procedure_(intrinsics_, wand, options),
          empty_(chosen_.size()) {}

    absl::Status check_live_step(LiveStep what) const override {
        return what == LiveStep::kEmptyScene ? absl::OkStatus() : ProcedureWork::check_live_step(what);
    }

    bool observe(const FrameResult& result, LiveStep what) override {
        const auto& images = result.frame_set.images;
        if (what == LiveStep::kEmptyScene) {
            for (std::size_t i = 0; i < chosen_.size(); ++i)
                if (!images[chosen_[i]].empty()) empty_[i] = images[chosen_[i]];
            return !needs_empty_scene();
        }
        const int frame_set = next_frame_set();
        int seen_by = 0;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Image& image = images[chosen_[i]];
            seen_[i].detected_in_latest = false;
            if (!image.empty() && has_room())
                seen_by += add(frame_set, static_cast<int>(i), detect_wand(image, empty_[i], wand_));
        }
        count_frame_set(seen_by);
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        return check_clips_without_floor(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto found = detect_wands(files.clips, wand_, {.stride = files.stride}, progress);
        if (!found.ok()) return found.status();
        add_clips(files, *found, [this](int frame_set, int index, const WandImage& image) {
            return has_room() && add(frame_set, index, image.wand);
        });
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report = TargetExtrinsicsWork::report();
        report.hints = procedure_.hints();
        report.sufficient = report.hints.empty();
        report.needs_empty_scene = needs_empty_scene();
        if (report.needs_empty_scene && report.shared_frame_set_count == 0)
            report.hints.insert(report.hints.begin(), "capture the empty scene first, then move the wand");
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        auto result = procedure_.solve(progress);
        if (!result.ok()) return result.status();
        const bool world_defined = inherit_world(cameras_, *result);
        return extrinsics_certificate("extrinsics_wand", *std::move(result), world_defined);
    }

  private:
    bool needs_empty_scene() const {
        return std::ranges::any_of(empty_, [](const Image& image) { return image.empty(); });
    }

    bool add(int frame_set, int index, const WandDetection& detection) {
        ++seen_[index].image_count;
        procedure_.add_observation(frame_set, index, detection);
        if (!detection) return reject_view(seen_[index], "not_found", ""), false;
        accept(index, *detection);
        return true;
    }

    WandSpec wand_;
    WandProcedure procedure_;
    std::vector<Image> empty_;  // per chosen camera
};

}  // namespace

ProcedureWorkOr make_wand_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                               const std::vector<std::size_t>& chosen) {
    const auto wand = parse_wand(request.wand);
    if (!wand.ok()) return wand.status();
    ExtrinsicsOptions options;
    options.refine_intrinsics = request.refine_intrinsics;
    return std::make_unique<WandWork>(*wand, options, cameras, chosen);
}

}  // namespace kinevox
