// Extrinsics from a moving board.
#include <fmt/format.h>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/procedure/procedure_kinds.h"

namespace kinevox {
namespace {

constexpr std::size_t kFloorFrameSets = 3;  // the board lies still: any of them will do

class BoardWork final : public TargetExtrinsicsWork {
  public:
    BoardWork(const BoardSpec& board, std::unique_ptr<BoardDetector> detector,
              const ExtrinsicsOptions& options, std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : TargetExtrinsicsWork(std::move(cameras), std::move(chosen)),
          board_(board),
          detector_(std::move(detector)),
          max_edge_px_(options.max_edge_px),
          procedure_(intrinsics_, board, options) {}

    absl::Status check_live_step(LiveStep what) const override {
        return what == LiveStep::kBoardOnFloor ? absl::OkStatus() : ProcedureWork::check_live_step(what);
    }

    bool observe(const FrameResult& result, LiveStep what) override {
        const int frame_set = next_frame_set();
        int seen_by = 0;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Image& image = result.frame_set.images[chosen_[i]];
            seen_[i].detected_in_latest = false;
            if (!image.empty()) seen_by += add(frame_set, static_cast<int>(i), detector_->detect(image));
        }
        count_frame_set(seen_by);
        if (what != LiveStep::kBoardOnFloor) return false;
        if (seen_by > 1) lying_.push_back(frame_set);
        return lying_.size() >= kFloorFrameSets;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (files.board_on_floor_frame && *files.board_on_floor_frame < 0)
            return absl::InvalidArgumentError(fmt::format(
                "board_on_floor_frame is {}; images are counted from 0", *files.board_on_floor_frame));
        if (files.board_on_floor_frame && *files.board_on_floor_frame % files.stride != 0)
            return absl::InvalidArgumentError(
                fmt::format("board_on_floor_frame {} is skipped by stride {}; give a multiple of the stride",
                            *files.board_on_floor_frame, files.stride));
        return check_clips(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto detections = detect_boards(files.clips, board_, {.stride = files.stride}, progress);
        if (!detections.ok()) return detections.status();
        const auto shared =
            add_clips(files, *detections, [this](int frame_set, int index, const BoardDetection& detection) {
                return add(frame_set, index, detection);
            });
        if (files.board_on_floor_frame)
            if (const auto lying = shared.find(*files.board_on_floor_frame); lying != shared.end())
                lying_.push_back(lying->second);
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report = TargetExtrinsicsWork::report();
        report.hints = procedure_.hints();
        report.floor_defined = !lying_.empty();
        report.sufficient = procedure_.complete() && report.floor_defined;
        if (!report.floor_defined)
            report.hints.push_back(
                "no board on the floor yet: lay it there to define floor and origin, or they are "
                "inherited from the active calibration");
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        auto result = procedure_.solve(progress);
        if (!result.ok()) return result.status();
        bool world_defined = false;
        if (!lying_.empty()) {
            if (absl::Status set = define_world_by_board(lying_, *result); !set.ok()) return set;
            world_defined = true;
        } else {
            world_defined = inherit_world(cameras_, *result);
        }
        return extrinsics_certificate("extrinsics_board", *std::move(result), world_defined);
    }

  private:
    // Returns whether it is usable.
    bool add(int frame_set, int index, const BoardDetection& detection) {
        CameraObservations& seen = seen_[index];
        ++seen.image_count;
        if (!has_room())
            return reject_view(seen, "no_room", "the maximum number of frame sets is stored; solve"), false;
        procedure_.add_observation(frame_set, index, detection);
        if (detection.mirrored_image)
            return reject_view(seen, "mirrored", "the image is mirrored: switch the camera's mirroring off"),
                   false;
        if (!detection.found()) return reject_view(seen, "not_found", ""), false;
        if (detection.edge_px > max_edge_px_)
            return reject_view(seen, "blurred",
                               fmt::format("blurred: edges are {:.1f} px wide", detection.edge_px)),
                   false;
        std::vector<Vec2> pixels;
        for (const Corner& corner : detection.corners) pixels.push_back(corner.pixel);
        accept(index, pixels);
        return true;
    }

    BoardSpec board_;
    std::unique_ptr<BoardDetector> detector_;
    double max_edge_px_;
    ExtrinsicsProcedure procedure_;
    std::vector<int> lying_;  // frame sets
};

}  // namespace

ProcedureWorkOr make_board_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                const std::vector<std::size_t>& chosen) {
    const auto board = parse_board(request.board);
    if (!board.ok()) return board.status();
    if (!board->has_direction())
        return absl::InvalidArgumentError(fmt::format(
            "{} is symmetric under half a turn, so that cameras cannot be matched by it; use one with an "
            "odd and an even number, or a ChArUco board",
            board_text(*board)));
    auto detector = BoardDetector::create(*board);
    if (!detector.ok()) return detector.status();
    ExtrinsicsOptions options;
    options.refine_intrinsics = request.refine_intrinsics;
    return std::make_unique<BoardWork>(*board, *std::move(detector), options, cameras, chosen);
}

}  // namespace kinevox
