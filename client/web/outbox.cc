#include "client/web/outbox.h"

#include <algorithm>
#include <utility>

namespace kinevox::web {
namespace {

// A message may be early by this fraction of its period: 25 Hz of a jittering 25 Hz stream loses none.
constexpr double kEarlyFraction = 0.2;

}  // namespace

void Outbox::subscribe(const std::vector<Subscription>& subscriptions) {
    std::map<Topic, Stream> before = std::exchange(streams_, {});
    for (const Subscription& s : subscriptions) {
        Stream stream;
        if (const auto old = before.find(s.topic); old != before.end()) stream = std::move(old->second);
        stream.period = std::chrono::duration_cast<Clock::duration>(
            std::chrono::duration<double>(s.max_rate_hz > 0 ? 1 / s.max_rate_hz : 0));
        streams_.emplace(s.topic, std::move(stream));
    }
    std::erase_if(order_, [&](const Topic& topic) { return !streams_.contains(topic); });
}

std::vector<Topic> Outbox::topics() const {
    std::vector<Topic> out;
    for (const auto& [topic, stream] : streams_) out.push_back(topic);
    return out;
}

void Outbox::put(const Topic& topic, const std::shared_ptr<const std::string>& body,
                 std::uint64_t dropped_count, Clock::time_point now) {
    const auto found = streams_.find(topic);
    if (found == streams_.end()) return;
    Stream& stream = found->second;
    stream.missed_count += dropped_count;
    if (now + std::chrono::duration_cast<Clock::duration>(kEarlyFraction * stream.period) < stream.next) {
        ++stream.missed_count;
        return;
    }
    stream.next = std::max(stream.next + stream.period, now);
    if (stream.queued)
        ++stream.missed_count;
    else
        order_.push_back(topic);
    stream.queued = body;
}

bool Outbox::reply(std::string body) {
    if (replies_.size() >= kMaxReplies) return false;
    replies_.push_back(std::move(body));
    return true;
}

std::optional<Outgoing> Outbox::take() {
    if (!replies_.empty()) {
        Outgoing out{{}, std::make_shared<const std::string>(std::move(replies_.front()))};
        replies_.pop_front();
        return out;
    }
    while (!order_.empty()) {
        const auto found = streams_.find(order_.front());
        order_.pop_front();
        if (found == streams_.end() || !found->second.queued) continue;
        web::v1::GatewayMessage head;
        head.set_missed_count(std::exchange(found->second.missed_count, 0));
        return Outgoing{head.SerializeAsString(), std::exchange(found->second.queued, nullptr)};
    }
    return {};
}

}  // namespace kinevox::web
