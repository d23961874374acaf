#include "tests/fuzz/fuzzed_daemon.h"

#include <grpcpp/create_channel.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <future>
#include <map>
#include <set>
#include <thread>

#include "server/access/call_table.h"
#include "server/access/guard.h"
#include "server/access/token_file.h"
#include "server/api/api_server.h"
#include "server/calibration/certificate/certificate.h"
#include "server/calibration/procedure/active_calibration.h"
#include "server/calibration/procedure/calibration_store.h"
#include "server/calibration/procedure/procedure.h"
#include "server/pipeline/convert.h"
#include "server/pose/body_model.h"
#include "server/pose/live_body_fit.h"
#include "server/recording/recorder.h"
#include "tests/fuzz/fuzz_check.h"
#include "tests/fuzz/fuzzed_folder.h"
#include "tests/fuzz/small_pose_options.h"
#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"

namespace kinevox::fuzz {
namespace {

namespace asio = boost::asio;
namespace fs = std::filesystem;
using std::chrono_literals::operator""ms;

constexpr const char* kSeed = "seed";  // a recording that always exists
constexpr std::uint64_t kSeedFrames = 5;

v1::Role role_of(Who who) {
    switch (who) {
        case Who::kAdmin:
            return v1::ROLE_ADMIN;
        case Who::kOperator:
            return v1::ROLE_OPERATOR;
        case Who::kDisplay:
            return v1::ROLE_DISPLAY;
        case Who::kViewer:
            return v1::ROLE_VIEWER;
        default:
            return v1::ROLE_UNSPECIFIED;
    }
}

// Files below a folder, with their sizes.
std::set<std::string> listing(const fs::path& folder) {
    std::set<std::string> out;
    for (const auto& entry : fs::recursive_directory_iterator(folder))
        out.insert(entry.path().string() +
                   (entry.is_regular_file() ? " " + std::to_string(entry.file_size()) : "/"));
    return out;
}

std::set<std::string> names_in(const fs::path& folder) {
    std::set<std::string> out;
    for (const auto& entry : fs::directory_iterator(folder)) out.insert(entry.path().filename().string());
    return out;
}

// Runs `act` on that thread and waits for it.
template <typename Act>
void on(asio::thread_pool& thread, const Act& act) {
    std::promise<void> done;
    asio::post(thread, [&] {
        act();
        done.set_value();
    });
    done.get_future().wait();
}

}  // namespace

struct FuzzedDaemon::Parts {
    testing::FuzzedFolder folder;
    const fs::path inside = folder.path() / "inside", outside = folder.path() / "outside";
    std::map<Who, std::string> tokens;
    std::unique_ptr<Guard> guard;

    std::atomic<std::int64_t> days = 0;  // offset of the lease's clock
    const std::shared_ptr<const Volume> volume = std::make_shared<const Volume>(testing::person_volume(0.05));
    testing::FakeSourceControl source;
    StreamHub hub;
    ControlLease lease{{}, [this] { return ControlLease::Clock::now() + std::chrono::hours(24 * days); }};
    Runner runner{source.open(), [this] { return source.open(); },
                  std::make_unique<testing::FakePipeline>(volume), hub};
    CalibrationStore calibrations{inside / "calibrations", "fake", runner.cameras()};
    ActiveCalibration use{calibrations, runner, [](const std::vector<Camera>&) {}};
    DatabaseWatch pose_watch;
    BodyWatch body_watch;
    ProcedureWatch procedure_watch;
    PoseDatabaseService poses{inside / "poses.kvxposes"};
    LiveBodyFit body_fit{runner.cameras(),
                         runner.source_fps(),
                         {},
                         body_options(),
                         {[this](const std::vector<BodyFitProgress>& all) { body_watch.publish(all); }, {}}};
    CalibrationProcedure procedure{
        [this](std::function<void()> on_ready) { return hub.subscribe_images(std::move(on_ready)); },
        [this](const Certificate& certificate, const std::string& note) {
            return calibrations.add(certificate.cameras, certificate_json(certificate), certificate.method,
                                    certificate.verdict(), note, 1);
        },
        [this] { return procedure_watch.watched(); },
        [this](const ProcedureProgress& progress) { procedure_watch.publish(progress); }};
    std::unique_ptr<Recorder> recorder;
    Replay replay{runner,
                  [this](const std::vector<Camera>&, double) -> absl::StatusOr<std::unique_ptr<Pipeline>> {
                      return std::make_unique<testing::FakePipeline>(volume);
                  },
                  [](EventKind, const std::string&) {}};

    asio::io_context io;
    asio::executor_work_guard<asio::io_context::executor_type> work{io.get_executor()};
    std::thread io_thread{[this] { io.run(); }};
    asio::thread_pool control{1}, changes{1}, calibrating{1}, recordings{1}, exports{1}, encoders{2};
    std::unique_ptr<ApiContext> api;
    std::unique_ptr<ApiServer> server;
    std::shared_ptr<grpc::Channel> channel;
    std::set<std::string> untouched;  // listing(outside)

    LiveBodyFitOptions body_options() const {
        LiveBodyFitOptions options;
        options.automatic = false;
        options.file = inside / "body.toml";
        return options;
    }

    void make_tokens() {
        const fs::path file = folder.path() / "access" / "tokens.toml";
        const std::int64_t now_s = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
        const auto make = [&](Who who, v1::Role role, std::int64_t when_s) {
            const auto token =
                create_token(file, {"of" + std::to_string(static_cast<int>(who)), role, 1}, when_s);
            FUZZ_CHECK(token.ok());
            tokens[who] = "Bearer " + *token;
        };
        for (const Who who : {Who::kAdmin, Who::kOperator, Who::kDisplay, Who::kViewer})
            make(who, role_of(who), now_s);
        make(Who::kExpired, v1::ROLE_ADMIN, now_s - 10 * 86'400);
        tokens[Who::kWrongToken] = "Bearer " + std::string(43, 'x');
        tokens[Who::kNoToken] = "";
        auto made = Guard::create(file, {100'000, 100'000, 1e6});
        FUZZ_CHECK(made.ok());
        guard = *std::move(made);
    }

    void make_recorder() {
        RecorderOptions options;
        options.folder = inside / "recordings";
        options.max_buffer_s = 1;
        options.max_buffer_bytes = options.max_queue_bytes = 8 << 20;
        options.min_free_bytes = 0;
        auto made = Recorder::create(
            options,
            [this] {
                return RecordedCapture{runner.cameras(), runner.source_fps(), use.active(), {}};
            },
            [](const Event&) {});
        FUZZ_CHECK(made.ok());
        recorder = *std::move(made);
        runner.set_result_observer([this](const FrameResult& result) {
            if (result.frame_set.recorded_frame) return;
            recorder->observe(result, [](std::uint32_t) { return nullptr; });
            body_fit.observe(result.capture_time_ns, {});
        });
        runner.set_observers(
            {[this](const FrameSet& frame_set) { recorder->offer(frame_set); },
             [this](const BackgroundImages& images) { recorder->background_learned(images); },
             [this] { recorder->capture_ended(); }});
    }

    // The recording that always exists, and a copy outside the daemon's folder.
    void record_seed() {
        FUZZ_CHECK(runner.start().ok());
        FUZZ_CHECK(recorder->start(kSeed, VideoCodec::kUtVideo).ok());
        source.give(static_cast<int>(kSeedFrames));
        for (;;) {
            const RecorderStatus status = recorder->status();
            if (status.current && status.current->about.frame_sets >= kSeedFrames) break;
            std::this_thread::sleep_for(1ms);
        }
        FUZZ_CHECK(recorder->stop().ok());
        FUZZ_CHECK(runner.stop().ok());
        fs::create_directories(outside);
        fs::copy(inside / "recordings" / kSeed, outside / "trial", fs::copy_options::recursive);
        untouched = listing(outside);
    }

    void build_poses() {
        std::vector<kernels::CameraModel> models;
        for (const Camera& camera : runner.cameras()) models.push_back(to_kernel(camera));
        poses.start(std::move(models), default_body_shape(), testing::small_pose_options(),
                    [this](const DatabaseProgress& progress) { pose_watch.publish(progress); });
        poses.wait();
    }

    void serve() {
        api = std::make_unique<ApiContext>(ApiContext{.runner = runner,
                                                      .hub = hub,
                                                      .lease = lease,
                                                      .threads = {.control = control.get_executor(),
                                                                  .encoders = encoders.get_executor(),
                                                                  .timers = io.get_executor(),
                                                                  .changes = changes.get_executor(),
                                                                  .calibrating = calibrating.get_executor(),
                                                                  .recordings = recordings.get_executor(),
                                                                  .exports = exports.get_executor()},
                                                      .poses = {&poses, &pose_watch, &body_fit, &body_watch},
                                                      .calibration = {.store = &calibrations,
                                                                      .active = &use,
                                                                      .procedure = &procedure,
                                                                      .procedure_watch = &procedure_watch},
                                                      .recorder = recorder.get(),
                                                      .replay = &replay,
                                                      .guard = guard.get(),
                                                      .source_description = "fake"});
        auto listening = ApiServer::listen("127.0.0.1:0", *api);
        FUZZ_CHECK(listening.ok());
        server = *std::move(listening);
        server->set_serving(true);
        channel = grpc::CreateChannel("127.0.0.1:" + std::to_string(server->port()),
                                      grpc::InsecureChannelCredentials());
    }

    Parts() {
        spdlog::set_level(spdlog::level::off);
        fs::create_directories(inside);
        make_tokens();
        make_recorder();
        runner.set_idle_timeout(100ms);
        record_seed();
        build_poses();
        serve();
    }

    ~Parts() {  // in the order of the daemon
        channel.reset();
        runner.abort();
        poses.close();
        body_fit.close();
        procedure.close();
        const absl::Status stopping = absl::UnavailableError("the daemon is stopping");
        hub.close(stopping);
        pose_watch.close(stopping);
        body_watch.close(stopping);
        procedure_watch.close(stopping);
        server->shutdown(100ms);
        for (asio::thread_pool* thread : {&control, &changes, &calibrating, &recordings, &exports})
            thread->join();
        runner.stop().IgnoreError();
        encoders.join();
        recorder->close();
        io.stop();
        io_thread.join();
    }

    void stop_capture() {
        if (replay.status().open) replay.close().IgnoreError();
        runner.stop().IgnoreError();
        while (!calibrations.applied().empty() && use.undo(false).ok()) {
        }
    }

    void forget_poses() {
        if (const auto there = poses.list(); there.ok())
            for (const PoseListing& pose : *there)
                if (pose.user_defined) FUZZ_CHECK(poses.remove(pose.label).ok());
    }

    void remove_files() {
        fs::remove_all(inside / "calibrations");
        fs::remove(inside / "body.toml");
        // The recorder's background images, which it may be writing.
        const auto is_background = [](const std::string& name) { return name.starts_with(".background-"); };
        for (const std::string& name : names_in(inside / "recordings"))
            if (name != kSeed && !is_background(name)) fs::remove_all(inside / "recordings" / name);
        if (!fs::exists(inside / "recordings" / kSeed / "session.toml"))
            fs::copy(outside / "trial", inside / "recordings" / kSeed, fs::copy_options::recursive);
    }

    void check_untouched() const {
        FUZZ_CHECK(names_in(folder.path()) == (std::set<std::string>{"access", "inside", "outside"}));
        FUZZ_CHECK(listing(outside) == untouched);
        for (const std::string& name : names_in(inside))
            FUZZ_CHECK(name == "recordings" || name == "calibrations" || name == "body.toml" ||
                       name == "poses.kvxposes");
    }
};

FuzzedDaemon::FuzzedDaemon() : parts_(std::make_unique<Parts>()) {}
FuzzedDaemon::~FuzzedDaemon() = default;

const std::string& FuzzedDaemon::token(Who who) const {
    return parts_->tokens.at(who == Who::kTwoTokens ? Who::kAdmin : who);
}

bool FuzzedDaemon::may(Who who, const std::string& path) const {
    const CallTable::Call* const call = parts_->guard->calls().find(path);
    return call && role_of(who) != v1::ROLE_UNSPECIFIED && has(role_of(who), call->permission);
}

std::shared_ptr<grpc::Channel> FuzzedDaemon::channel() const {
    return parts_->channel;
}
void FuzzedDaemon::give(int frame_sets) {
    parts_->source.give(frame_sets);
}
const std::filesystem::path& FuzzedDaemon::root() const {
    return parts_->folder.path();
}

std::string FuzzedDaemon::acquire_control() {
    const auto granted = parts_->lease.acquire("fuzzer", 0ms, "");
    FUZZ_CHECK(granted.ok());
    return granted->lease_id;
}

void FuzzedDaemon::reset() {
    Parts& p = *parts_;
    // Each on the thread of its calls, where a cancelled one may still be running.
    on(p.exports, [] {});
    on(p.recordings, [&] {
        if (p.recorder->status().state != RecorderState::kIdle) p.recorder->stop().IgnoreError();
    });
    on(p.calibrating, [&] {
        if (p.procedure.progress().open()) p.procedure.cancel(false).IgnoreError();
    });
    on(p.control, [&] { p.stop_capture(); });
    on(p.changes, [&] { p.forget_poses(); });
    ++p.days;  // expires the lease
    p.check_untouched();
    p.remove_files();
}

}  // namespace kinevox::fuzz
