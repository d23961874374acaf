// Messages queued for one browser: the latest of each subscribed stream, and a few replies. Bounded, whatever
// the browser does. One thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/web/subscription_request.h"

namespace kinevox::web {

using Clock = std::chrono::steady_clock;

// A GatewayMessage in two pieces: protobuf merges concatenated messages.
struct Outgoing {
    std::string head;                         // of this browser: missed_count
    std::shared_ptr<const std::string> body;  // the same for all browsers
};

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
