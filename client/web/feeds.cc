#include "client/web/feeds.h"

#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace kinevox::web {

struct Feeds::Feed {
    Topic topic;
    std::uint64_t id = 0;
    bool leaving = false;

    // From the reading thread to the gateway's: the newest message, and whether the word was passed on.
    std::mutex mutex;
    std::shared_ptr<const std::string> newest;
    std::uint64_t lost = 0;

    std::optional<absl::Status> link;  // the reading thread's; as it was told last

    std::jthread thread;  // last: ends before the rest goes
};

Feeds::Feeds(DaemonStreams& daemon, Options options) : daemon_(daemon), options_(std::move(options)) {}

Feeds::~Feeds() {
    for (const auto& [id, feed] : feeds_) feed->thread.request_stop();  // all at once, then joined one by one
}

void Feeds::want(const std::set<Topic>& topics) {
    std::set<Topic> running;
    for (const auto& [id, feed] : feeds_) {
        if (feed->leaving) continue;
        if (topics.contains(feed->topic)) {
            running.insert(feed->topic);
            continue;
        }
        feed->leaving = true;
        feed->thread.request_stop();
    }
    for (const Topic& topic : topics)
        if (!running.contains(topic)) begin(topic);
}

void Feeds::begin(const Topic& topic) {
    Feed& feed = *feeds_.emplace(next_id_, std::make_unique<Feed>()).first->second;
    feed.topic = topic;
    feed.id = next_id_++;
    const auto deliver = [this, &feed] {
        std::shared_ptr<const std::string> body;
        std::uint64_t lost = 0;
        {
            const std::lock_guard lock(feed.mutex);
            body = std::exchange(feed.newest, nullptr);
            lost = std::exchange(feed.lost, 0);
        }
        if (!feed.leaving) options_.on_message(feed.topic, body, lost);
    };
    DaemonStreams::Listener listener;
    listener.on_message = [this, &feed, deliver](std::string bytes) {
        auto body = std::make_shared<const std::string>(std::move(bytes));
        const std::lock_guard lock(feed.mutex);
        if (feed.newest) ++feed.lost;
        const bool told = std::exchange(feed.newest, std::move(body)) != nullptr;
        if (!told) options_.post(deliver);
    };
    listener.on_link = [this, &feed](const absl::Status& link) {
        if (feed.link == link) return;
        feed.link = link;
        options_.post([this, link] { options_.on_link(link); });
    };
    feed.thread = std::jthread([this, &feed, listener](const std::stop_token& stop) {
        const absl::Status why = daemon_.read(feed.topic, stop, listener);
        options_.post([this, id = feed.id, why] { ended(id, why); });
    });
}

// Behind everything else that this feed posted.
void Feeds::ended(std::uint64_t id, const absl::Status& why) {
    const auto found = feeds_.find(id);
    const Topic topic = found->second->topic;
    const bool by_itself = !found->second->leaving;
    feeds_.erase(found);
    if (by_itself) options_.on_end(topic, why);
}

}  // namespace kinevox::web
