// A daemon that plays an exhibit's day at many times its speed: visitors come, move and leave.
//
// usage: scripted_daemon --write FILE      one cycle as gateway messages, each as uint32 length and bytes
//        scripted_daemon --frames N        serves N poses and N volumes on a free port, at most 2000 of each
//        per second, and prints the numbers sent
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <thread>
#include <vector>

#include "common/body_table.h"
#include "common/volume_codec.h"
#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"
#include "kinevox/web/v1/exhibit.pb.h"
#include "tests/support/person_volume.h"

namespace {

namespace v1 = kinevox::v1;

// At 25 Hz a cycle is one minute: 40 s with a visitor, the last two of them without a pose, then an empty
// scene.
constexpr int kCycle = 1500, kVisit = 1000, kUnmeasured = 50, kVolumes = 32;
constexpr double kVoxel_m = 0.04;  // the page lays out volumes of all sizes equally
// A subscriber that is never given a pause shows the size of its receive buffers, not what it keeps.
constexpr std::chrono::microseconds kMinInterval{500};

void fill_header(v1::StreamHeader& header, std::uint64_t n) {
    header.set_sequence(n + 1);
    header.set_capture_time_ns(static_cast<std::int64_t>(n) * 40'000'000);
}

// 0: the scene is empty.
std::uint32_t subject_id(std::uint64_t n) {
    return n % kCycle < kVisit ? static_cast<std::uint32_t>(n / kCycle + 1) : 0;
}

class Script {
  public:
    Script() {
        const kinevox::Volume person = kinevox::testing::person_volume(kVoxel_m);
        for (int n = 0; n < kVolumes; ++n) {  // moves in a circle and changes its size
            kinevox::Volume moved = person;
            moved.grid.origin_in_world.x += 0.4 * std::cos(2 * M_PI * n / kVolumes);
            moved.grid.origin_in_world.y += 0.4 * std::sin(2 * M_PI * n / kVolumes);
            const std::size_t less = moved.bricks.size() * static_cast<std::size_t>(n % 5) / 20;
            moved.bricks.resize(moved.bricks.size() - less);
            if (less > 0) moved.colours.clear();
            if (moved.colours.empty())
                moved.colours.assign(kinevox::surface_voxels(moved).size(),
                                     {static_cast<std::uint8_t>(8 * n), 120, 90});
            volumes_.push_back(kinevox::encode_volume(moved));
        }
    }

    v1::StreamPosesResponse pose(std::uint64_t n) const {
        v1::StreamPosesResponse out;
        fill_header(*out.mutable_header(), n);
        if (subject_id(n) == 0) return out;
        v1::SubjectPose& subject = *out.add_subjects();
        subject.set_subject_id(subject_id(n));
        const int at = static_cast<int>(n % kCycle);
        if (at >= kVisit - kUnmeasured) return out;
        v1::Pose& pose = *subject.mutable_pose();
        const double turn = 2 * M_PI * at / 200.0;
        for (std::size_t j = 0; j < kinevox::kJointNames.size(); ++j) {
            v1::JointEstimate& joint = *pose.add_joints();
            joint.set_name(std::string(kinevox::kJointNames[j]));
            if ((at / 25 + static_cast<int>(j)) % 11 == 0) {
                joint.set_withheld_reason("script");
                continue;
            }
            joint.mutable_position_in_world()->set_x(0.3 * std::sin(turn + static_cast<double>(j)));
            joint.mutable_position_in_world()->set_y(0.3 * std::cos(turn + static_cast<double>(j)));
            joint.mutable_position_in_world()->set_z(0.08 * static_cast<double>(j) + 0.1);
        }
        for (const char* name :
             {"knee_flexion_geometric_l", "knee_flexion_geometric_r", "elbow_flexion_geometric_l",
              "elbow_flexion_geometric_r", "hip_flexion_geometric_l", "hip_flexion_geometric_r",
              "hip_abduction_geometric_l", "hip_abduction_geometric_r", "shoulder_elevation_geometric_l",
              "shoulder_elevation_geometric_r", "trunk_lean_geometric"}) {
            v1::AngleEstimate& angle = *pose.add_angles();
            angle.set_name(name);
            if (at % 97 == 0)
                angle.set_withheld_reason("script");
            else
                angle.set_value_deg(60 + 60 * std::sin(turn * (1 + 0.1 * pose.angles_size())));
        }
        return out;
    }

    v1::StreamVolumesResponse volume(std::uint64_t n) const {
        v1::StreamVolumesResponse out;
        fill_header(*out.mutable_header(), n);
        if (subject_id(n) == 0) return out;
        v1::SubjectVolume& subject = *out.add_subjects();
        subject.mutable_subject()->set_subject_id(subject_id(n));
        subject.set_encoded_volume(volumes_[n % kVolumes]);
        subject.set_voxel_m(kVoxel_m);
        subject.set_volume_litres(70 + static_cast<double>(n % 40));
        return out;
    }

  private:
    std::vector<std::string> volumes_;
};

class Daemon final : v1::CaptureService::Service, v1::StreamService::Service {
  public:
    Daemon(const Script& script, std::uint64_t frames) : script_(script), frames_(frames) {
        grpc::ServerBuilder builder;
        builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
        builder.RegisterService(static_cast<v1::CaptureService::Service*>(this));
        builder.RegisterService(static_cast<v1::StreamService::Service*>(this));
        server_ = builder.BuildAndStart();
    }
    int port = 0;
    std::atomic<std::uint64_t> poses{0}, volumes{0};

  private:
    template <typename Message, typename Make>
    grpc::Status send(grpc::ServerContext* context, grpc::ServerWriter<Message>* writer,
                      std::atomic<std::uint64_t>& sent, const Make& make) {
        auto next = std::chrono::steady_clock::now();
        while (!context->IsCancelled() && sent < frames_) {
            if (!writer->Write(make(sent))) break;
            ++sent;
            next = std::max(next + kMinInterval, std::chrono::steady_clock::now());
            std::this_thread::sleep_until(next);
        }
        while (!context->IsCancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
        return grpc::Status::OK;
    }
    grpc::Status GetStatus(grpc::ServerContext*, const v1::GetStatusRequest*,
                           v1::GetStatusResponse* response) override {
        response->set_state(v1::CAPTURE_STATE_RUNNING);
        return grpc::Status::OK;
    }
    grpc::Status StreamPoses(grpc::ServerContext* context, const v1::StreamPosesRequest*,
                             grpc::ServerWriter<v1::StreamPosesResponse>* writer) override {
        return send(context, writer, poses, [&](std::uint64_t n) { return script_.pose(n); });
    }
    grpc::Status StreamVolumes(grpc::ServerContext* context, const v1::StreamVolumesRequest*,
                               grpc::ServerWriter<v1::StreamVolumesResponse>* writer) override {
        return send(context, writer, volumes, [&](std::uint64_t n) { return script_.volume(n); });
    }

    const Script& script_;
    const std::uint64_t frames_;
    std::unique_ptr<grpc::Server> server_;
};

int write(const Script& script, const char* file) {
    std::ofstream out(file, std::ios::binary);
    const auto add = [&](const kinevox::web::v1::GatewayMessage& message) {
        const std::string bytes = message.SerializeAsString();
        const auto length = static_cast<std::uint32_t>(bytes.size());
        out.write(reinterpret_cast<const char*>(&length), sizeof length) << bytes;
    };
    for (int n = 0; n < kCycle; ++n) {
        kinevox::web::v1::GatewayMessage pose, volume;
        *pose.mutable_pose() = script.pose(static_cast<std::uint64_t>(n));
        *volume.mutable_volume() = script.volume(static_cast<std::uint64_t>(n));
        add(pose);
        add(volume);
    }
    return out.flush() ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
    const std::string verb = argc == 3 ? argv[1] : "";
    if (verb != "--write" && verb != "--frames") {
        std::fprintf(stderr, "usage: scripted_daemon --write FILE | --frames N\n");
        return 1;
    }
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    const Script script;
    if (verb == "--write") return write(script, argv[2]);
    Daemon daemon(script, std::stoull(argv[2]));
    std::printf("ready on 127.0.0.1:%d\n", daemon.port);
    std::fflush(stdout);
    const timespec look{0, 500'000'000};
    while (sigtimedwait(&signals, nullptr, &look) < 0) {
        std::printf("%llu %llu\n", static_cast<unsigned long long>(daemon.poses),
                    static_cast<unsigned long long>(daemon.volumes));
        std::fflush(stdout);
    }
    std::_Exit(0);  // subscribers may hold streams open
}
