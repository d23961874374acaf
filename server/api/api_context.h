// Everything that the services use. All of it outlives the gRPC server.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "server/api/control_lease.h"
#include "server/api/subscribers.h"
#include "server/calibration/procedure/active_calibration.h"
#include "server/calibration/procedure/camera_watch.h"
#include "server/pipeline/replay.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

namespace quality {
class LiveQuality;
}
class Gpu;
class Guard;
class Recorder;
struct CaptureStatistics;

struct ApiContext {
    Runner& runner;
    StreamHub& hub;
    ControlLease& lease;

    boost::asio::any_io_executor control;   // one thread: start, stop and learn the background, in turn
    boost::asio::any_io_executor encoders;  // encode and write volumes and images
    boost::asio::any_io_executor timers;    // the io_context: rate timers

    // The pose database and the subscribers of its state; null if there is none. `changes`: one thread that
    // changes it.
    PoseDatabaseService* poses = nullptr;
    DatabaseWatch* pose_watch = nullptr;
    boost::asio::any_io_executor changes{};

    // The body fit and the subscribers of its state; null if the daemon measures no poses.
    LiveBodyFit* body_fit = nullptr;
    BodyWatch* body_watch = nullptr;

    // Stored calibrations, the active one, the procedure and the subscribers of its state; all or none.
    // `calibrating`: one thread that accesses their files.
    CalibrationStore* calibrations = nullptr;
    ActiveCalibration* active_calibration = nullptr;
    CalibrationProcedure* procedure = nullptr;
    ProcedureWatch* procedure_watch = nullptr;
    boost::asio::any_io_executor calibrating{};

    // The recorder, and the thread that its calls block.
    Recorder* recorder = nullptr;
    boost::asio::any_io_executor recordings{};
    boost::asio::any_io_executor exports{};  // one thread: creates export files, one export after the other

    const CameraWatch* camera_watch = nullptr;  // null if the cameras are not watched for movement

    const quality::LiveQuality* quality = nullptr;  // null: results are not judged

    CaptureStatistics* statistics = nullptr;  // for the metrics; null: disabled

    Replay* replay = nullptr;  // null: replay is not supported
    // Sessions may be opened by path from these and from the folder of recordings.
    std::vector<std::filesystem::path> replay_folders{};

    Guard* guard = nullptr;  // null: no access control and no limits

    FairShare* fair_share = nullptr;  // limits latest-only subscribers; null: unlimited
    const Gpu* gpu = nullptr;         // null if none is configured

    std::string source_description;  // "session /data/trial/session.toml"
    std::chrono::steady_clock::time_point started_at = std::chrono::steady_clock::now();
    std::size_t lossless_max_messages = 256;
    std::size_t lossless_max_bytes = std::size_t{32} << 20;
    int preview_width_px = 320;     // if a subscriber requests no size
    int preview_jpeg_quality = 80;  // if a subscriber requests none
    double max_stream_rate_hz = 1000;
};

// Restarts the lease's timeout. FAILED_PRECONDITION if `lease_id` does not hold control.
inline absl::Status use_control(const ApiContext& api, const std::string& lease_id) {
    return api.lease.use(lease_id).status();
}

}  // namespace kinevox
