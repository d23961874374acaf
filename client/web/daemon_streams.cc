#include "client/web/daemon_streams.h"

#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "client/lib/connection.h"
#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"

namespace kinevox::web {
namespace {

constexpr std::chrono::milliseconds kFirstPause{200}, kMaxPause{5'000}, kStatusInterval{1'000},
    kStatusTimeout{3'000};
constexpr int kSilhouetteWidth_px = 480, kSilhouetteQuality = 75;
constexpr double kSilhouettes_hz = 25;

void pause(std::chrono::milliseconds time, const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any never;
    std::unique_lock lock(mutex);
    never.wait_for(lock, stop, time, [] { return false; });
}

bool is_final(const absl::Status& status) {
    return absl::IsNotFound(status) || absl::IsInvalidArgument(status) || absl::IsPermissionDenied(status) ||
           absl::IsUnauthenticated(status);
}

// Of volumes or states, which contain a Subject.
template <typename Message>
void clear_names(Message& message) {
    for (auto& subject : *message.mutable_subjects())
        if (subject.has_subject()) subject.mutable_subject()->clear_name();
}

}  // namespace

struct DaemonStreams::Parts {
    client::ClientOptions options;
    bool show_names = false;
    std::unique_ptr<kinevox::v1::CaptureService::Stub> capture;
    std::unique_ptr<kinevox::v1::StreamService::Stub> stream;

    // Reads a stream until it ends; `any`: whether a message arrived.
    template <typename Message, typename Prepare, typename Wrap>
    absl::Status once(const Prepare& prepare, const Wrap& wrap, const std::stop_token& stop,
                      const Listener& listener, bool& any) {
        client::StreamOptions stream_options;
        stream_options.stop = stop;
        return client::read_stream_once<Message>(
            prepare,
            [&](const Message& message) -> absl::StatusOr<bool> {
                web::v1::GatewayMessage out;
                wrap(message, out);
                listener.on_message(out.SerializeAsString());
                return true;
            },
            stream_options, options, any);
    }

    absl::Status poses(const std::stop_token& stop, const Listener& listener, bool& any) {
        return once<kinevox::v1::StreamPosesResponse>(
            [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
                return stream->PrepareAsyncStreamPoses(context, {}, queue);
            },
            [this](const auto& message, web::v1::GatewayMessage& out) {
                *out.mutable_pose() = message;
                if (show_names) return;
                for (kinevox::v1::SubjectPose& subject : *out.mutable_pose()->mutable_subjects())
                    subject.clear_name();
            },
            stop, listener, any);
    }

    absl::Status volumes(int downsample_level, const std::stop_token& stop, const Listener& listener,
                         bool& any) {
        kinevox::v1::StreamVolumesRequest request;
        request.set_downsample_level(downsample_level);
        return once<kinevox::v1::StreamVolumesResponse>(
            [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
                return stream->PrepareAsyncStreamVolumes(context, request, queue);
            },
            [this, downsample_level](const auto& message, web::v1::GatewayMessage& out) {
                out.set_downsample_level(downsample_level);
                *out.mutable_volume() = message;
                if (!show_names) clear_names(*out.mutable_volume());
            },
            stop, listener, any);
    }

    // The only previews that are requested: silhouettes, never images.
    absl::Status silhouettes(const std::string& camera, const std::stop_token& stop, const Listener& listener,
                             bool& any) {
        kinevox::v1::StreamPreviewsRequest request;
        request.set_camera(camera);
        request.set_kind(kinevox::v1::StreamPreviewsRequest::KIND_SILHOUETTE);
        request.set_max_width_px(kSilhouetteWidth_px);
        request.set_jpeg_quality(kSilhouetteQuality);
        request.set_max_rate_hz(kSilhouettes_hz);
        return once<kinevox::v1::StreamPreviewsResponse>(
            [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
                return stream->PrepareAsyncStreamPreviews(context, request, queue);
            },
            [](const auto& message, web::v1::GatewayMessage& out) { *out.mutable_silhouette() = message; },
            stop, listener, any);
    }

    absl::Status status(const std::stop_token& stop, const Listener& listener) {
        while (!stop.stop_requested()) {
            grpc::ClientContext context;
            client::prepare_context(context, options);
            context.set_deadline(std::chrono::system_clock::now() + kStatusTimeout);
            const std::stop_callback cancel(stop, [&] { context.TryCancel(); });
            web::v1::GatewayMessage out;
            kinevox::v1::GetStatusResponse& response = *out.mutable_status();
            const absl::Status called = client::to_absl(capture->GetStatus(&context, {}, &response), options);
            if (stop.stop_requested()) break;
            listener.on_connection(called);
            response.clear_source();
            response.clear_control_lease();
            if (!show_names) clear_names(response);
            for (kinevox::v1::CameraStatus& camera : *response.mutable_cameras()) camera.clear_connection();
            if (called.ok()) listener.on_message(out.SerializeAsString());
            pause(kStatusInterval, stop);
        }
        return absl::CancelledError("stopped");
    }

    absl::Status once(const Topic& topic, const std::stop_token& stop, const Listener& listener, bool& any) {
        switch (topic.kind) {
            case Topic::Kind::kPoses:
                return poses(stop, listener, any);
            case Topic::Kind::kVolumes:
                return volumes(topic.downsample_level, stop, listener, any);
            case Topic::Kind::kSilhouette:
                return silhouettes(topic.camera, stop, listener, any);
            case Topic::Kind::kStatus:
                break;
        }
        return status(stop, listener);
    }
};

DaemonStreams::DaemonStreams(const client::ClientOptions& options, bool show_names)
    : parts_(std::make_unique<Parts>()) {
    parts_->options = options;
    parts_->show_names = show_names;
    const auto channel = client::connect(options);
    parts_->capture = kinevox::v1::CaptureService::NewStub(channel);
    parts_->stream = kinevox::v1::StreamService::NewStub(channel);
}

DaemonStreams::~DaemonStreams() = default;

absl::Status DaemonStreams::read(const Topic& topic, const std::stop_token& stop, const Listener& listener) {
    auto next = kFirstPause;
    for (;;) {
        bool any = false;
        const absl::Status ended = parts_->once(topic, stop, listener, any);
        if (stop.stop_requested()) return absl::CancelledError("stopped");
        if (is_final(ended)) return ended;
        next = any ? kFirstPause : std::min(2 * next, kMaxPause);
        pause(next, stop);
    }
}

struct StreamPool::Stream {
    Topic topic;
    std::uint64_t id = 0;
    bool stopping = false;

    // From the reading thread to the gateway's: the latest message.
    std::mutex mutex;
    std::shared_ptr<const std::string> latest;
    std::uint64_t dropped_count = 0;

    std::optional<absl::Status> connection;  // reading thread only: the state that was published last

    std::jthread thread;  // last: joined before the other members are destroyed
};

StreamPool::StreamPool(DaemonStreams& daemon, Options options)
    : daemon_(daemon), options_(std::move(options)) {}

StreamPool::~StreamPool() {
    for (const auto& [id, stream] : streams_)
        stream->thread.request_stop();  // all, before the first is joined
}

void StreamPool::set_topics(const std::set<Topic>& topics) {
    std::set<Topic> running;
    for (const auto& [id, stream] : streams_) {
        if (stream->stopping) continue;
        if (topics.contains(stream->topic)) {
            running.insert(stream->topic);
            continue;
        }
        stream->stopping = true;
        stream->thread.request_stop();
    }
    for (const Topic& topic : topics)
        if (!running.contains(topic)) start(topic);
}

void StreamPool::start(const Topic& topic) {
    Stream& stream = *streams_.emplace(next_id_, std::make_unique<Stream>()).first->second;
    stream.topic = topic;
    stream.id = next_id_++;
    const auto deliver = [this, &stream] {
        std::shared_ptr<const std::string> body;
        std::uint64_t dropped_count = 0;
        {
            const std::lock_guard lock(stream.mutex);
            body = std::exchange(stream.latest, nullptr);
            dropped_count = std::exchange(stream.dropped_count, 0);
        }
        if (!stream.stopping) options_.on_message(stream.topic, body, dropped_count);
    };
    DaemonStreams::Listener listener;
    listener.on_message = [this, &stream, deliver](std::string bytes) {
        auto body = std::make_shared<const std::string>(std::move(bytes));
        const std::lock_guard lock(stream.mutex);
        if (stream.latest) ++stream.dropped_count;
        const bool posted = std::exchange(stream.latest, std::move(body)) != nullptr;
        if (!posted) options_.post(deliver);
    };
    listener.on_connection = [this, &stream](const absl::Status& connection) {
        if (stream.connection == connection) return;
        stream.connection = connection;
        options_.post([this, connection] { options_.on_connection(connection); });
    };
    stream.thread = std::jthread([this, &stream, listener](const std::stop_token& stop) {
        const absl::Status reason = daemon_.read(stream.topic, stop, listener);
        options_.post([this, id = stream.id, reason] { ended(id, reason); });
    });
}

// Runs after everything else that this stream posted.
void StreamPool::ended(std::uint64_t id, const absl::Status& reason) {
    const auto found = streams_.find(id);
    const Topic topic = found->second->topic;
    const bool ended_by_daemon = !found->second->stopping;
    streams_.erase(found);
    if (ended_by_daemon) options_.on_end(topic, reason);
}

}  // namespace kinevox::web
