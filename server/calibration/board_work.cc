// Places from a board moved through the space.
#include <fmt/format.h>

#include "server/calibration/extrinsics.h"
#include "server/calibration/place_work.h"
#include "server/calibration/solved_certificate.h"

namespace kinevox {
namespace {

constexpr std::size_t kFloorMoments = 3;  // the board lies still: any of them will do

class BoardWork final : public PlaceWork {
  public:
    BoardWork(const BoardSpec& board, std::unique_ptr<BoardDetector> detector,
              const ExtrinsicsOptions& options, std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : PlaceWork(std::move(cameras), std::move(chosen)),
          board_(board),
          detector_(std::move(detector)),
          max_edge_px_(options.max_edge_px),
          procedure_(lenses_, board, options) {}

    absl::Status check_taking(Taking what) const override {
        return what == Taking::kBoardOnFloor ? absl::OkStatus() : ProcedureWork::check_taking(what);
    }

    bool observe(const FrameResult& result, Taking what) override {
        const int moment = next_moment();
        int seen_by = 0;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            const Picture& picture = result.frame_set.pictures[chosen_[i]];
            seen_[i].seen_last = false;
            if (!picture.empty()) seen_by += add(moment, static_cast<int>(i), detector_->detect(picture));
        }
        count_moment(seen_by);
        if (what != Taking::kBoardOnFloor) return false;
        if (seen_by > 1) lying_.push_back(moment);
        return lying_.size() >= kFloorMoments;
    }

    absl::Status check_files(ProcedureFiles& files) const override {
        if (files.floor_frame && *files.floor_frame < 0)
            return absl::InvalidArgumentError(
                fmt::format("floor_frame is {}; pictures count from 0", *files.floor_frame));
        if (files.floor_frame && *files.floor_frame % files.every != 0)
            return absl::InvalidArgumentError(
                fmt::format("floor_frame {} is not looked at with every {}; give a "
                            "multiple of it",
                            *files.floor_frame, files.every));
        return check_clips(cameras_, chosen_, files);
    }

    absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) override {
        const auto sightings = find_boards(files.clips, board_, {.every = files.every}, progress);
        if (!sightings.ok()) return sightings.status();
        const auto shared =
            add_clips(files, *sightings, [this](int moment, int index, const BoardSighting& sighting) {
                return add(moment, index, sighting);
            });
        if (files.floor_frame)
            if (const auto lying = shared.find(*files.floor_frame); lying != shared.end())
                lying_.push_back(lying->second);
        return absl::OkStatus();
    }

    ProcedureReport report() const override {
        ProcedureReport report = PlaceWork::report();
        report.hints = procedure_.hints();
        report.floor_seen = !lying_.empty();
        report.complete = procedure_.complete() && report.floor_seen;
        if (!report.floor_seen)
            report.hints.push_back(
                "no board has lain on the floor: lay it there to set floor and origin, or they are "
                "those of the calibration in use");
        return report;
    }

    absl::StatusOr<Certificate> solve(const SolveProgress& progress) const override {
        auto result = procedure_.solve(progress);
        if (!result.ok()) return result.status();
        bool world_is_set = false;
        if (!lying_.empty()) {
            if (absl::Status set = set_world_by_board(lying_, *result); !set.ok()) return set;
            world_is_set = true;
        } else {
            world_is_set = take_over_world(cameras_, *result);
        }
        return place_certificate("board", *std::move(result), world_is_set);
    }

  private:
    // Whether it can be used.
    bool add(int moment, int index, const BoardSighting& sighting) {
        ObservedCamera& seen = seen_[index];
        ++seen.pictures;
        if (!has_room())
            return reject_view(seen, "no room", "as many moments are kept as can be; solve"), false;
        procedure_.add_observation(moment, index, sighting);
        if (sighting.mirrored_picture)
            return reject_view(seen, "mirrored",
                               "the picture is a mirror image: switch the camera's mirroring off"),
                   false;
        if (!sighting.found()) return reject_view(seen, "not found", ""), false;
        if (sighting.edge_px > max_edge_px_)
            return reject_view(seen, "blurred",
                               fmt::format("blurred: edges are {:.1f} px wide", sighting.edge_px)),
                   false;
        std::vector<Vec2> pixels;
        for (const Corner& corner : sighting.corners) pixels.push_back(corner.pixel);
        accept(index, pixels);
        return true;
    }

    BoardSpec board_;
    std::unique_ptr<BoardDetector> detector_;
    double max_edge_px_;
    ExtrinsicsProcedure procedure_;
    std::vector<int> lying_;  // moments
};

}  // namespace

MadeWork make_board_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                         const std::vector<std::size_t>& chosen) {
    const auto board = parse_board(request.board);
    if (!board.ok()) return board.status();
    if (!board->has_direction())
        return absl::InvalidArgumentError(fmt::format(
            "{} looks the same after half a turn, so that cameras cannot be matched by it; use one with an "
            "odd and an even number, or a ChArUco board",
            board_text(*board)));
    auto detector = BoardDetector::create(*board);
    if (!detector.ok()) return detector.status();
    ExtrinsicsOptions options;
    options.refine_lenses = request.refine_lenses;
    return std::make_unique<BoardWork>(*board, *std::move(detector), options, cameras, chosen);
}

}  // namespace kinevox
