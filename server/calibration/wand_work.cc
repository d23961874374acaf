// Places from a wand waved through the space.
#include <fmt/format.h>

#include "server/calibration/place_work.h"
#include "server/calibration/solved_certificate.h"
#include "server/calibration/wand_clips.h"

namespace kinevox {
namespace {

class WandWork final : public PlaceWork {
  public:
    WandWork(const WandSpec& wand, const ExtrinsicsOptions& options, std::vector<Camera> cameras,
             std::vector<std::size_t> chosen)
        : PlaceWork(std::move(cameras), std::move(chosen)),
          wand_(wand),
          procedure_(lenses_, wand, options),
          empty_(chosen_.size()) {}

    absl::Status check_taking(Taking what) const override {
        return what == Taking::kEmptyScene ? absl::OkStatus() : ProcedureWork::check_taking(what);
    }

    bool observe(const FrameResult& result, Taking what) override {
        const auto& pictures = result.frame_set.pictures;
        if (what == Taking::kEmptyScene) {
            for (std::size_t i = 0; i < chosen_.size(); ++i)
                if (!pictures[chosen_[i]].empty()) empty_[i] = pictures[chosen_[i]];
            return !needs_empty_scene();
        }
        const int moment = next_moment();
        int seen_by = 0;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Picture& picture = pictures[chosen_[i]];
            seen_[i].seen_last = false;
            if (!picture.empty() && has_room())
                seen_by += add(moment, static_cast<int>(i), find_wand(picture, empty_[i], wand_));
        }
        count_moment(seen_by);
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (files.floor_frame)
            return absl::InvalidArgumentError("floor_frame is given; a wand shows no floor, a board does");
        return check_clips(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto found = find_wands(files.clips, wand_, {.every = files.every}, progress);
        if (!found.ok()) return found.status();
        add_clips(files, *found, [this](int moment, int index, const WandPicture& picture) {
            return has_room() && add(moment, index, picture.wand);
        });
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report = PlaceWork::report();
        report.hints = procedure_.hints();
        report.complete = report.hints.empty();
        report.needs_empty_scene = needs_empty_scene();
        if (report.needs_empty_scene && report.moments == 0)
            report.hints.insert(report.hints.begin(),
                                "take a picture of the empty scene first, then wave the wand");
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        auto result = procedure_.solve(progress);
        if (!result.ok()) return result.status();
        const bool world_is_set = take_over_world(cameras_, *result);
        return place_certificate("wand", *std::move(result), world_is_set);
    }

  private:
    bool needs_empty_scene() const {
        return std::ranges::any_of(empty_, [](const Picture& picture) { return picture.empty(); });
    }

    bool add(int moment, int index, const WandSighting& sighting) {
        ++seen_[index].pictures;
        procedure_.add_observation(moment, index, sighting);
        if (!sighting) return reject_view(seen_[index], "not found", ""), false;
        accept(index, *sighting);
        return true;
    }

    WandSpec wand_;
    WandProcedure procedure_;
    std::vector<Picture> empty_;  // per chosen camera
};

}  // namespace

MadeWork make_wand_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                        const std::vector<std::size_t>& chosen) {
    const auto wand = parse_wand(request.wand);
    if (!wand.ok()) return wand.status();
    ExtrinsicsOptions options;
    options.refine_lenses = request.refine_lenses;
    return std::make_unique<WandWork>(*wand, options, cameras, chosen);
}

}  // namespace kinevox
