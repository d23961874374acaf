// What the services work on. Everything in it outlives the gRPC server.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <chrono>
#include <string>

#include "server/api/control_lease.h"
#include "server/api/state_watch.h"
#include "server/calibration/calibration_use.h"
#include "server/calibration/camera_watch.h"
#include "server/pipeline/replay.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

class FairShare;
class Gpu;
class Guard;
class Recorder;
namespace metrics {
struct CaptureFigures;
}

struct ApiContext {
    Runner& runner;
    StreamHub& hub;
    ControlLease& lease;

    boost::asio::any_io_executor control;   // one thread: start, stop and learning, one after the other
    boost::asio::any_io_executor encoders;  // volumes and pictures are encoded and written here
    boost::asio::any_io_executor clock;     // the io_context: rate timers

    // The pose database and who follows its building; null where there is none. Changes to it, one thread.
    PoseDatabaseService* poses = nullptr;
    DatabaseWatch* pose_watch = nullptr;
    boost::asio::any_io_executor changes{};

    // The fit of the subject's body and who follows it; null where no poses are measured.
    LiveBodyFit* body_fit = nullptr;
    BodyWatch* body_watch = nullptr;

    // Calibrations, which of them is used, the procedure and who follows it; all or none. What they do with
    // files, one thread.
    CalibrationStore* calibrations = nullptr;
    CalibrationUse* calibration_use = nullptr;
    CalibrationProcedure* procedure = nullptr;
    ProcedureWatch* procedure_watch = nullptr;
    boost::asio::any_io_executor calibrating{};

    // What records the capture, and the thread that its calls wait on.
    Recorder* recorder = nullptr;
    boost::asio::any_io_executor recordings{};
    boost::asio::any_io_executor exports{};  // one thread: files for other programs, one after the other

    const CameraWatch* camera_watch = nullptr;  // null where nothing watches the cameras' places

    metrics::CaptureFigures* figures = nullptr;  // counted for monitoring; null: nobody looks

    Replay* replay = nullptr;  // null where nothing can be replayed

    Guard* guard = nullptr;  // null: everybody may do everything, as often as he likes

    FairShare* share = nullptr;  // of the subscribers to the newest; null: as often as there is one
    const Gpu* gpu = nullptr;    // null where none is asked for

    std::string source_description;  // "session /data/trial/session.toml"
    std::chrono::steady_clock::time_point started_at = std::chrono::steady_clock::now();
    std::size_t lossless_max_messages = 256;
    std::size_t lossless_max_bytes = std::size_t{32} << 20;
    int preview_width_px = 320;     // where a subscriber asks for no size
    int preview_jpeg_quality = 80;  // where a subscriber asks for none
    double max_stream_rate_hz = 1000;
};

}  // namespace kinevox
