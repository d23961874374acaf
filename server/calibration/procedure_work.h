// What a calibration procedure of each kind does with what the cameras see: observe, hint, solve.
// CalibrationProcedure (procedure.h) gives it a thread, frame sets and an end.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board_clips.h"
#include "server/calibration/certificate.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

enum class ProcedureKind { kIntrinsics, kExtrinsicsBoard, kExtrinsicsWand, kRefinePerson };

// What the next live frame sets show.
enum class Taking { kNothing, kMoving, kBoardOnFloor, kEmptyScene };

struct ProcedureRequest {
    ProcedureKind kind = ProcedureKind::kIntrinsics;
    std::vector<std::string> cameras;  // empty: all
    std::string board, wand;           // as parse_board() and parse_wand() read them
    bool refine_lenses = false;        // extrinsics: the lenses may move a little with the places
    bool k3 = false;                   // intrinsics
    double subject_height_m = 0;       // refining: as measured; 0: not known
    std::string note;                  // kept with the calibration
};

struct ProcedureFiles {
    std::vector<CameraClip> clips;   // board and wand; their sizes are filled in by check_files()
    int every = 1;                   // every so many pictures only
    std::optional<int> floor_frame;  // board: the picture in which it lies on the floor
    std::filesystem::path session;   // refining
};

struct ObservedCamera {
    std::string name;
    int pictures = 0;                     // that were looked at
    int accepted = 0;                     // with something that can be used
    std::map<std::string, int> rejected;  // by a short reason: "not found", "blurred"
    double coverage = 0;                  // part of the picture that was covered, 0 to 1
    std::vector<int> coverage_counts;     // see Coverage
    bool seen_last = false;               // in the newest picture
    std::string last_rejection;           // why the newest view that was rejected was
};

struct ProcedureReport {
    std::vector<ObservedCamera> cameras;
    std::vector<std::string> hints;  // what to do next, a sentence each
    bool complete = false;           // more observations would add little
    bool full = false;               // no more observations are kept
    bool floor_seen = false;         // the world will be set by a board on the floor
    int moments = 0;                 // with something seen by two cameras or more
    bool needs_empty_scene = false;  // before anything else can be taken
};

// One thread at a time.
class ProcedureWork {
  public:
    // `cameras`: all of the daemon's, with the lenses to use and the places in use. InvalidArgument for a
    // request that cannot be, NotFound for a camera that is not there; FailedPrecondition for too few
    // cameras.
    static absl::StatusOr<std::unique_ptr<ProcedureWork>> create(const ProcedureRequest& request,
                                                                 const std::vector<Camera>& cameras);
    virtual ~ProcedureWork() = default;

    // One frame set of the running capture, pictures in the order of the cameras. True: `what` is over by it.
    virtual bool observe(const FrameResult& seen, Taking what) = 0;
    // Whether live frame sets may show that, else InvalidArgument. Any thread.
    virtual absl::Status check_taking(Taking what) const;

    // What is wrong with files, before they are read; fills in the clips' sizes. Any thread.
    virtual absl::Status check_files(ProcedureFiles& files) const = 0;
    // Adds all that they show or, on an error or when cancelled by `progress`, nothing.
    virtual absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) = 0;

    virtual ProcedureReport report() const = 0;

    // The certificate's cameras are the calibration: all of the daemon's cameras that it has places for.
    // FailedPrecondition where too little was seen, Cancelled by `progress`.
    virtual absl::StatusOr<Certificate> solve(const SolveProgress& progress) const = 0;

    // Views, or moments, that are kept at most.
    static constexpr int kMaxViews = 2000;
};

}  // namespace kinevox
