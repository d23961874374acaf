// What waits for one browser: the newest message of each stream it asked for, and a few answers. Bounded,
// whatever the browser does. One thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/web/wants.h"

namespace kinevox::web {

using Clock = std::chrono::steady_clock;

// A GatewayMessage in two pieces: protobuf joins what stands one behind the other.
struct Outgoing {
    std::string head;                         // this browser's own: missed
    std::shared_ptr<const std::string> body;  // the same for all browsers
};

class Outbox {
  public:
    static constexpr std::size_t kMaxAnswers = 32;

    // What was asked for before and is not among these is dropped.
    void subscribe(const std::vector<Subscription>& subscriptions);
    void unsubscribe(const Topic& topic) { streams_.erase(topic); }
    std::vector<Topic> topics() const;

    // The newest of a stream, kept if this browser wants it now. `lost`: messages that the gateway dropped
    // before it.
    void put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t lost,
             Clock::time_point now);
    // A refusal or the daemon's link. False: too many wait already; the browser does not read.
    bool answer(std::string body);

    // Answers first, then streams in the order in which their messages came.
    std::optional<Outgoing> take();
    bool empty() const { return answers_.empty() && order_.empty(); }

  private:
    struct Stream {
        std::shared_ptr<const std::string> waiting;
        std::uint64_t missed = 0;
        Clock::duration period{0};
        Clock::time_point next;  // earliest, with a limit on the rate
    };
    std::map<Topic, Stream> streams_;
    std::deque<Topic> order_;  // of those with something waiting
    std::deque<std::string> answers_;
};

}  // namespace kinevox::web
