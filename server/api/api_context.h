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

// Calls that block run on a thread of their kind, in turn.
struct ApiThreads {
    boost::asio::any_io_executor control{};      // one thread: start, stop and learn the background
    boost::asio::any_io_executor encoders{};     // encode and write volumes and images
    boost::asio::any_io_executor timers{};       // the io_context: rate timers
    boost::asio::any_io_executor changes{};      // one thread: changes of the pose database
    boost::asio::any_io_executor calibrating{};  // one thread: files of calibrations
    boost::asio::any_io_executor recordings{};   // calls of the recorder
    boost::asio::any_io_executor exports{};      // one thread: creates one export file after the other
};

struct ApiPoses {
    PoseDatabaseService* database = nullptr;  // null: there is none
    DatabaseWatch* database_watch = nullptr;  // subscribers of its state
    LiveBodyFit* body_fit = nullptr;          // null: the daemon measures no poses
    BodyWatch* body_watch = nullptr;          // subscribers of its state
};

// All but camera_watch, or none.
struct ApiCalibration {
    CalibrationStore* store = nullptr;
    ActiveCalibration* active = nullptr;
    CalibrationProcedure* procedure = nullptr;
    ProcedureWatch* procedure_watch = nullptr;  // subscribers of its state
    const CameraWatch* camera_watch = nullptr;  // null: the cameras are not watched for movement
};

struct ApiStreams {
    FairShare* fair_share = nullptr;  // limits latest-only subscribers; null: unlimited
    std::size_t lossless_max_messages = 256;
    std::size_t lossless_max_bytes = std::size_t{32} << 20;
    int preview_width_px = 320;     // if a subscriber requests no size
    int preview_jpeg_quality = 80;  // if a subscriber requests none
    double max_rate_hz = 1000;
};

struct ApiContext {
    Runner& runner;
    StreamHub& hub;
    ControlLease& lease;
    ApiThreads threads;

    ApiPoses poses{};
    ApiCalibration calibration{};
    ApiStreams streams{};
    Recorder* recorder = nullptr;
    Replay* replay = nullptr;  // null: replay is not supported
    // Sessions may be opened by path from these and from the folder of recordings.
    std::vector<std::filesystem::path> replay_folders{};

    const quality::LiveQuality* quality = nullptr;  // null: results are not judged
    CaptureStatistics* statistics = nullptr;        // for the metrics; null: disabled
    Guard* guard = nullptr;                         // null: no access control and no limits
    const Gpu* gpu = nullptr;                       // null if none is configured

    std::string source_description;  // "session /data/trial/session.toml"
    std::chrono::steady_clock::time_point started_at = std::chrono::steady_clock::now();
};

// Restarts the lease's timeout. FAILED_PRECONDITION if `lease_id` does not hold control.
inline absl::Status use_control(const ApiContext& api, const std::string& lease_id) {
    return api.lease.use(lease_id).status();
}

}  // namespace kinevox
