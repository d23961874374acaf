// Intrinsics from a board: one IntrinsicsProcedure per camera.
#include <fmt/format.h>

#include "server/calibration/board/intrinsics.h"
#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/procedure/procedure_kinds.h"

namespace kinevox {
namespace {

const char* short_reason(ViewUse use) {
    switch (use) {
        case ViewUse::kNotFound:
            return "not_found";
        case ViewUse::kMirrored:
            return "mirrored";
        case ViewUse::kBlurred:
            return "blurred";
        case ViewUse::kDuplicate:
            return "duplicate";
        case ViewUse::kParallel:
            return "parallel";
        case ViewUse::kOutlier:
            return "outlier";
        case ViewUse::kUsed:
        case ViewUse::kUnused:
            break;
    }
    return "";
}

class IntrinsicsWork final : public ProcedureWork {
  public:
    IntrinsicsWork(const BoardSpec& board, std::unique_ptr<BoardDetector> detector, bool k3,
                   std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : board_(board),
          detector_(std::move(detector)),
          cameras_(std::move(cameras)),
          chosen_(std::move(chosen)) {
        IntrinsicsOptions options;
        options.k3 = k3;
        for (const std::size_t c : chosen_) {
            const Camera& camera = cameras_[c];
            views_.push_back({IntrinsicsProcedure(camera.name, camera.width, camera.height, board, options),
                              Coverage(camera.width, camera.height),
                              {},
                              0});
            views_.back().seen.name = camera.name;
        }
    }

    bool observe(const FrameResult& result, LiveStep) override {
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Image& image = result.frame_set.images[chosen_[i]];
            views_[i].seen.detected_in_latest = false;
            if (!image.empty()) add(views_[i], static_cast<int>(result.sequence), detector_->detect(image));
        }
        return false;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        return check_clips_without_floor(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto detections = detect_boards(files.clips, board_, {.stride = files.stride}, progress);
        if (!detections.ok()) return detections.status();
        for (std::size_t clip = 0; clip < files.clips.size(); ++clip)
            for (CameraViews& views : views_)
                if (views.seen.name == files.clips[clip].camera)
                    for (std::size_t i = 0; i < (*detections)[clip].size(); ++i)
                        add(views, static_cast<int>(i) * files.stride, (*detections)[clip][i]);
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.sufficient = true;
        for (const CameraViews& views : views_) {
            report.cameras.push_back(views.seen);
            report.cameras.back().coverage = views.coverage.fraction();
            report.cameras.back().coverage_counts = views.coverage.counts();
            for (std::string& hint : views.procedure.hints()) report.hints.push_back(std::move(hint));
            report.sufficient = report.sufficient && views.procedure.complete();
            report.full = report.full || views.kept >= kMaxViews;
        }
        return report;
    }

    // The extrinsics are kept; the certificate says that they were found with other intrinsics.
    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        std::vector<IntrinsicsResult> results;
        for (const CameraViews& views : views_) {
            const auto before = static_cast<double>(results.size()), all = static_cast<double>(views_.size());
            auto result = views.procedure.solve([&](double fraction, const std::string& what) {
                return !progress || progress((before + fraction) / all, what);
            });
            if (!result.ok()) return result.status();
            results.push_back(*std::move(result));
        }
        Certificate certificate = intrinsics_certificate(std::move(results));
        std::vector<Camera> cameras = cameras_;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Rigid3 pose = cameras[chosen_[i]].camera_from_world;
            cameras[chosen_[i]] = certificate.cameras[i];
            cameras[chosen_[i]].camera_from_world = pose;
        }
        certificate.cameras = std::move(cameras);
        certificate.world_defined = true;
        certificate.findings.push_back(
            {Verdict::kCaution, "extrinsics_outdated", "",
             "the extrinsics are those of the active calibration, found with other intrinsics",
             "calibrate the extrinsics next, with these intrinsics"});
        return certificate;
    }

  private:
    struct CameraViews {
        IntrinsicsProcedure procedure;
        Coverage coverage;
        CameraObservations seen;
        int kept = 0;
    };

    static void add(CameraViews& views, int frame, const BoardDetection& detection) {
        CameraObservations& seen = views.seen;
        ++seen.image_count;
        seen.detected_in_latest = detection.found();
        if (!detection.found() && !detection.mirrored_image) return reject_view(seen, "not_found", "");
        if (views.kept >= kMaxViews)
            return reject_view(seen, "no_room", "the maximum number of views is stored; solve");
        ++views.kept;
        const IntrinsicsView view = views.procedure.add_observation(frame, detection);
        if (view.use != ViewUse::kUnused) return reject_view(seen, short_reason(view.use), view.reason);
        ++seen.accepted_count;
        for (const Corner& corner : view.corners) views.coverage.add(corner.pixel);
    }

    BoardSpec board_;
    std::unique_ptr<BoardDetector> detector_;
    std::vector<Camera> cameras_;
    std::vector<std::size_t> chosen_;
    std::vector<CameraViews> views_;
};

}  // namespace

ProcedureWorkOr make_intrinsics_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                     const std::vector<std::size_t>& chosen) {
    const auto board = parse_board(request.board);
    if (!board.ok()) return board.status();
    auto detector = BoardDetector::create(*board);
    if (!detector.ok()) return detector.status();
    return std::make_unique<IntrinsicsWork>(*board, *std::move(detector), request.estimate_k3, cameras,
                                            chosen);
}

}  // namespace kinevox
