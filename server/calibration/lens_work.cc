// Lenses from a board: one IntrinsicsProcedure a camera.
#include <fmt/format.h>

#include "server/calibration/intrinsics.h"
#include "server/calibration/procedure_works.h"
#include "server/calibration/solved_certificate.h"

namespace kinevox {
namespace {

const char* short_reason(ViewUse use) {
    switch (use) {
        case ViewUse::kNotFound:
            return "not found";
        case ViewUse::kMirrored:
            return "mirrored";
        case ViewUse::kBlurred:
            return "blurred";
        case ViewUse::kSameAsBefore:
            return "same as before";
        case ViewUse::kParallel:
            return "parallel";
        case ViewUse::kDoesNotFit:
            return "does not fit";
        case ViewUse::kUsed:
        case ViewUse::kSpare:
            break;
    }
    return "";
}

class LensWork final : public ProcedureWork {
  public:
    LensWork(const BoardSpec& board, std::unique_ptr<BoardDetector> detector, bool k3,
             std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : board_(board),
          detector_(std::move(detector)),
          cameras_(std::move(cameras)),
          chosen_(std::move(chosen)) {
        IntrinsicsOptions options;
        options.k3 = k3;
        for (const std::size_t c : chosen_) {
            const Camera& camera = cameras_[c];
            lenses_.push_back({IntrinsicsProcedure(camera.name, camera.width, camera.height, board, options),
                               Coverage(camera.width, camera.height),
                               {},
                               0});
            lenses_.back().seen.name = camera.name;
        }
    }

    bool observe(const FrameResult& result, Taking) override {
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Picture& picture = result.frame_set.pictures[chosen_[i]];
            lenses_[i].seen.seen_last = false;
            if (!picture.empty())
                add(lenses_[i], static_cast<int>(result.sequence), detector_->detect(picture));
        }
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (files.floor_frame)
            return absl::InvalidArgumentError(
                "floor_frame is given; lenses have no floor, places from a board have");
        return check_clips(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto sightings = find_boards(files.clips, board_, {.every = files.every}, progress);
        if (!sightings.ok()) return sightings.status();
        for (std::size_t clip = 0; clip < files.clips.size(); ++clip)
            for (Lens& lens : lenses_)
                if (lens.seen.name == files.clips[clip].camera)
                    for (std::size_t i = 0; i < (*sightings)[clip].size(); ++i)
                        add(lens, static_cast<int>(i) * files.every, (*sightings)[clip][i]);
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.complete = true;
        for (const Lens& lens : lenses_) {
            report.cameras.push_back(lens.seen);
            report.cameras.back().coverage = lens.coverage.part();
            report.cameras.back().coverage_counts = lens.coverage.counts();
            for (std::string& hint : lens.procedure.hints()) report.hints.push_back(std::move(hint));
            report.complete = report.complete && lens.procedure.complete();
            report.full = report.full || lens.kept >= kMaxViews;
        }
        return report;
    }

    // The places stay as they are; they were found with other lenses, which the certificate says.
    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        std::vector<IntrinsicsResult> results;
        for (const Lens& lens : lenses_) {
            const auto before = static_cast<double>(results.size()),
                       all = static_cast<double>(lenses_.size());
            auto result = lens.procedure.solve([&](double part, const std::string& what) {
                return !progress || progress((before + part) / all, what);
            });
            if (!result.ok()) return result.status();
            results.push_back(*std::move(result));
        }
        Certificate certificate = lens_certificate(std::move(results));
        certificate.made_by = "lenses";
        std::vector<Camera> cameras = cameras_;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Rigid3 place = cameras[chosen_[i]].camera_from_world;
            cameras[chosen_[i]] = certificate.cameras[i];
            cameras[chosen_[i]].camera_from_world = place;
        }
        certificate.cameras = std::move(cameras);
        certificate.world_is_set = true;
        certificate.findings.push_back(
            {Verdict::kCare, "places", "",
             "the cameras' places are those of the calibration in use, found with other lenses",
             "calibrate the places next, with these lenses"});
        return certificate;
    }

  private:
    struct Lens {
        IntrinsicsProcedure procedure;
        Coverage coverage;
        ObservedCamera seen;
        int kept = 0;
    };

    static void add(Lens& lens, int frame, const BoardSighting& sighting) {
        ObservedCamera& seen = lens.seen;
        ++seen.pictures;
        seen.seen_last = sighting.found();
        if (!sighting.found() && !sighting.mirrored_picture) return reject_view(seen, "not found", "");
        if (lens.kept >= kMaxViews)
            return reject_view(seen, "no room", "as many views are kept as can be; solve");
        ++lens.kept;
        const IntrinsicsView view = lens.procedure.add_observation(frame, sighting);
        if (view.use != ViewUse::kSpare) return reject_view(seen, short_reason(view.use), view.reason);
        ++seen.accepted;
        for (const Corner& corner : view.corners) lens.coverage.add(corner.pixel);
    }

    BoardSpec board_;
    std::unique_ptr<BoardDetector> detector_;
    std::vector<Camera> cameras_;
    std::vector<std::size_t> chosen_;
    std::vector<Lens> lenses_;
};

}  // namespace

MadeWork make_lens_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                        const std::vector<std::size_t>& chosen) {
    const auto board = parse_board(request.board);
    if (!board.ok()) return board.status();
    auto detector = BoardDetector::create(*board);
    if (!detector.ok()) return detector.status();
    return std::make_unique<LensWork>(*board, *std::move(detector), request.k3, cameras, chosen);
}

}  // namespace kinevox
