// What a browser subscribes to, and the messages queued for it.
#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kinevox/web/v1/exhibit.pb.h"

namespace kinevox::web {

// One stream of the daemon, shared by all browsers that subscribe to it. There is no kind for camera images.
struct Topic {
    enum class Kind : std::uint8_t { kPoses, kVolumes, kStatus, kSilhouette };
    Kind kind = Kind::kPoses;
    int downsample_level = 0;  // of volumes
    std::string camera;        // of a silhouette
    auto operator<=>(const Topic&) const = default;
};

struct Subscription {
    Topic topic;
    double max_rate_hz = 0;  // 0: no limit
};

struct SubscriptionRequest {
    std::vector<Subscription> accepted;  // each topic once
    std::vector<web::v1::StreamError> errors;
    bool valid = true;  // false: `accepted` is empty and the earlier subscriptions stay
};

inline constexpr std::size_t kMaxBrowserMessage_bytes = 4096;
inline constexpr int kMaxSubscriptions = 16;

// Parses one BrowserMessage as received. This is the only place that rejects subscriptions.
SubscriptionRequest parse_subscriptions(std::string_view bytes);

using Clock = std::chrono::steady_clock;

// A GatewayMessage in two pieces: protobuf merges concatenated messages.
struct Outgoing {
    std::string head;                         // of this browser: missed_count
    std::shared_ptr<const std::string> body;  // the same for all browsers
};

// Messages queued for one browser: the latest of each subscribed stream, and a few replies. Bounded, whatever
// the browser does. One thread.
class Outbox {
  public:
    static constexpr std::size_t kMaxReplies = 32;

    // Replaces the earlier subscriptions; messages of others are dropped.
    void subscribe(const std::vector<Subscription>& subscriptions);
    void unsubscribe(const Topic& topic) { streams_.erase(topic); }
    std::vector<Topic> topics() const;

    // Queues the latest message of a stream, if subscribed and due. `dropped_count`: messages that the
    // gateway dropped before it.
    void put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t dropped_count,
             Clock::time_point now);
    // Queues an error or the daemon's connection. False: too many are queued; the browser does not read.
    bool reply(std::string body);

    // Replies first, then stream messages in order of arrival.
    std::optional<Outgoing> take();
    bool empty() const { return replies_.empty() && order_.empty(); }

  private:
    struct Stream {
        std::shared_ptr<const std::string> queued;
        std::uint64_t missed_count = 0;
        Clock::duration period{0};
        Clock::time_point next;  // earliest time of the next message, by the rate limit
    };
    std::map<Topic, Stream> streams_;
    std::deque<Topic> order_;  // of streams with a queued message
    std::deque<std::string> replies_;
};

}  // namespace kinevox::web
