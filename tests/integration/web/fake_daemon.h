// A scripted daemon that records the requests it gets.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"

namespace kinevox::testing {

class FakeDaemon final : kinevox::v1::CaptureService::Service, kinevox::v1::StreamService::Service {
  public:
    explicit FakeDaemon(int port = 0) {
        grpc::ServerBuilder builder;
        builder.AddListeningPort("127.0.0.1:" + std::to_string(port), grpc::InsecureServerCredentials(),
                                 &port_);
        builder.RegisterService(static_cast<kinevox::v1::CaptureService::Service*>(this));
        builder.RegisterService(static_cast<kinevox::v1::StreamService::Service*>(this));
        server_ = builder.BuildAndStart();
    }
    ~FakeDaemon() override {
        ending_ = true;
        server_->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(2));
    }

    int port() const { return port_; }
    std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
    std::set<int> preview_kinds() const {
        const std::lock_guard lock(mutex_);
        return preview_kinds_;
    }

    static std::string volume_bytes() { return std::string("KVXV\0\1any bytes", 15); }
    std::atomic<int> pause_ms{5};  // between two messages
    std::atomic<std::size_t> volume_padding{0};
    std::atomic<int> streams{0};  // running now

  private:
    struct Running {
        explicit Running(std::atomic<int>& count) : count(count) { ++count; }
        ~Running() { --count; }
        std::atomic<int>& count;
    };
    template <typename Message, typename Fill>
    grpc::Status stream(grpc::ServerContext* context, grpc::ServerWriter<Message>* writer, const Fill& fill) {
        const Running running(streams);
        for (std::uint64_t n = 1; !context->IsCancelled() && !ending_; ++n) {
            Message message;
            message.mutable_header()->set_sequence(n);
            fill(message);
            if (!writer->Write(message)) break;
            std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
        }
        return {grpc::StatusCode::UNAVAILABLE, "the daemon is stopping"};
    }

    grpc::Status GetStatus(grpc::ServerContext*, const kinevox::v1::GetStatusRequest*,
                           kinevox::v1::GetStatusResponse* response) override {
        response->set_version("fake");
        response->set_state(kinevox::v1::CAPTURE_STATE_RUNNING);
        response->set_source("session /home/ann/secret");
        response->mutable_control_lease()->set_operator_name("ann");
        response->add_cameras()->set_name("cam1");
        response->add_subjects()->mutable_subject()->set_name("Anna");
        response->mutable_cameras(0)->mutable_connection()->set_device("Maker 21548823 at 10.0.0.7");
        return grpc::Status::OK;
    }
    grpc::Status StreamPoses(grpc::ServerContext* context, const kinevox::v1::StreamPosesRequest*,
                             grpc::ServerWriter<kinevox::v1::StreamPosesResponse>* writer) override {
        return stream(context, writer, [](kinevox::v1::StreamPosesResponse& message) {
            kinevox::v1::SubjectPose& subject = *message.add_subjects();
            subject.set_subject_id(1);
            subject.set_name("Anna");
            subject.mutable_pose()->add_angles()->set_name("trunk_lean_geometric");
        });
    }
    grpc::Status StreamVolumes(grpc::ServerContext* context, const kinevox::v1::StreamVolumesRequest* request,
                               grpc::ServerWriter<kinevox::v1::StreamVolumesResponse>* writer) override {
        return stream(context, writer, [&](kinevox::v1::StreamVolumesResponse& message) {
            kinevox::v1::SubjectVolume& subject = *message.add_subjects();
            subject.mutable_subject()->set_subject_id(1);
            subject.mutable_subject()->set_name("Anna");
            subject.set_encoded_volume(volume_bytes() + std::string(volume_padding, 'x'));
            subject.set_voxel_m(0.01 * (1 << request->downsample_level()));
        });
    }
    grpc::Status StreamPreviews(grpc::ServerContext* context,
                                const kinevox::v1::StreamPreviewsRequest* request,
                                grpc::ServerWriter<kinevox::v1::StreamPreviewsResponse>* writer) override {
        {
            const std::lock_guard lock(mutex_);
            preview_kinds_.insert(request->kind());
        }
        if (request->camera() != "cam1")
            return {grpc::StatusCode::NOT_FOUND, "unknown camera; the cameras are cam1"};
        return stream(context, writer, [](kinevox::v1::StreamPreviewsResponse& message) {
            message.set_camera("cam1");
            message.set_jpeg("a silhouette");
        });
    }

    int port_ = 0;
    std::atomic<bool> ending_{false};
    mutable std::mutex mutex_;
    std::set<int> preview_kinds_;
    std::unique_ptr<grpc::Server> server_;
};

}  // namespace kinevox::testing
