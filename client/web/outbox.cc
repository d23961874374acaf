#include "client/web/outbox.h"

#include <algorithm>
#include <utility>

namespace kinevox::web {
namespace {

// A message may come so much of its period early, so that 25 Hz out of a jittering 25 Hz loses none.
constexpr double kEarly = 0.2;

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

void Outbox::put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t lost,
                 Clock::time_point now) {
    const auto found = streams_.find(topic);
    if (found == streams_.end()) return;
    Stream& stream = found->second;
    stream.missed += lost;
    if (now + std::chrono::duration_cast<Clock::duration>(kEarly * stream.period) < stream.next) {
        ++stream.missed;
        return;
    }
    stream.next = std::max(stream.next + stream.period, now);
    if (stream.waiting)
        ++stream.missed;
    else
        order_.push_back(topic);
    stream.waiting = body;
}

bool Outbox::answer(std::string body) {
    if (answers_.size() >= kMaxAnswers) return false;
    answers_.push_back(std::move(body));
    return true;
}

std::optional<Outgoing> Outbox::take() {
    if (!answers_.empty()) {
        Outgoing out{{}, std::make_shared<const std::string>(std::move(answers_.front()))};
        answers_.pop_front();
        return out;
    }
    while (!order_.empty()) {
        const auto found = streams_.find(order_.front());
        order_.pop_front();
        if (found == streams_.end() || !found->second.waiting) continue;
        web::v1::GatewayMessage head;
        head.set_missed(std::exchange(found->second.missed, 0));
        return Outgoing{head.SerializeAsString(), std::exchange(found->second.waiting, nullptr)};
    }
    return {};
}

}  // namespace kinevox::web
