// The work of each kind of calibration procedure: observe, hint, solve. CalibrationProcedure (procedure.h)
// adds the thread, the frame sets and the end.
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
#include "server/calibration/board/board_clips.h"
#include "server/calibration/certificate/certificate.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

enum class ProcedureKind { kIntrinsics, kExtrinsicsBoard, kExtrinsicsWand, kExtrinsicsRefinePerson };

// Content of the next live frame sets.
enum class LiveStep { kPause, kMovingTarget, kBoardOnFloor, kEmptyScene };

struct ProcedureRequest {
    ProcedureKind kind = ProcedureKind::kIntrinsics;
    std::vector<std::string> cameras;  // empty: all
    std::string board, wand;           // parsed by parse_board() and parse_wand()
    bool refine_intrinsics = false;    // extrinsics: refine the intrinsics, too
    bool estimate_k3 = false;          // intrinsics
    double stature_m = 0;              // refining: as measured; 0: unknown
    std::string note;                  // stored with the calibration
};

struct ProcedureFiles {
    std::vector<CameraClip> clips;            // board and wand; their sizes are filled in by check_files()
    int stride = 1;                           // every Nth image
    std::optional<int> board_on_floor_frame;  // board: image in which it lies on the floor
    std::filesystem::path session_path;       // refining
};

struct CameraObservations {
    std::string name;
    int image_count = 0;                    // processed
    int accepted_count = 0;                 // with a usable detection
    std::map<std::string, int> rejections;  // by reason: "not_found", "blurred"
    double coverage = 0;                    // covered fraction of the image, 0 to 1
    std::vector<int> coverage_counts;       // see Coverage
    bool detected_in_latest = false;        // target detected in the latest image
    std::string latest_rejection_reason;    // of the latest rejected view
};

struct ProcedureReport {
    std::vector<CameraObservations> cameras;
    std::vector<std::string> hints;  // what to do next, one sentence each
    bool sufficient = false;         // more observations would add little
    bool full = false;               // no more observations are stored
    bool floor_defined = false;      // a board on the floor will define the world frame
    int shared_frame_set_count = 0;  // with detections in two or more cameras
    bool needs_empty_scene = false;  // must be captured first
};

// One thread at a time.
class ProcedureWork {
  public:
    // `cameras`: all of the daemon's, with the intrinsics to use and the active extrinsics. InvalidArgument
    // for an invalid request, NotFound for an unknown camera; FailedPrecondition for too few cameras.
    static absl::StatusOr<std::unique_ptr<ProcedureWork>> create(const ProcedureRequest& request,
                                                                 const std::vector<Camera>& cameras);
    virtual ~ProcedureWork() = default;

    // One frame set of the running capture, images in the order of the cameras. Returns true when the step is
    // complete.
    virtual bool observe(const FrameResult& seen, LiveStep what) = 0;
    // InvalidArgument if this kind does not use the step. Any thread.
    virtual absl::Status check_live_step(LiveStep what) const;

    // Checks files before they are read; fills in the clips' sizes. Any thread.
    virtual absl::Status check_files(ProcedureFiles& files) const = 0;
    // Adds all observations of the files; on an error or when cancelled by `progress`, none.
    virtual absl::Status read(const ProcedureFiles& files, const SolveProgress& progress) = 0;

    virtual ProcedureReport report() const = 0;

    // The certificate's cameras are the calibration: all of the daemon's cameras that it has extrinsics for.
    // FailedPrecondition if the observations do not suffice, Cancelled by `progress`.
    virtual absl::StatusOr<Certificate> solve(const SolveProgress& progress) const = 0;

    // Maximum number of stored views, or frame sets.
    static constexpr int kMaxViews = 2000;
};

}  // namespace kinevox
