#include "client/web/stream_pool.h"

#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace kinevox::web {

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
