#include "client/web/subscriptions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace kinevox::web {
namespace {

constexpr int kMaxDownsampleLevel = 5;
constexpr double kMinRate_hz = 0.001, kMaxRate_hz = 1000;
constexpr std::size_t kMaxName_bytes = 100;

v1::StreamError stream_error(const char* code, std::string message) {
    v1::StreamError out;
    out.set_code(code);
    out.set_message(std::move(message));
    return out;
}

SubscriptionRequest invalid_request(std::string message) {
    SubscriptionRequest out;
    out.valid = false;
    out.errors.push_back(stream_error("INVALID_ARGUMENT", std::move(message)));
    return out;
}

// Sets the topic, or the error.
bool parse_topic(const v1::StreamSubscription& requested, Topic& topic, v1::StreamError& error) {
    switch (requested.kind()) {
        case v1::STREAM_KIND_POSES:
            topic = {Topic::Kind::kPoses, 0, {}};
            return true;
        case v1::STREAM_KIND_STATUS:
            topic = {Topic::Kind::kStatus, 0, {}};
            return true;
        case v1::STREAM_KIND_VOLUMES:
            topic = {Topic::Kind::kVolumes, requested.downsample_level(), {}};
            if (requested.downsample_level() >= 0 && requested.downsample_level() <= kMaxDownsampleLevel)
                return true;
            error = stream_error("INVALID_ARGUMENT",
                                 fmt::format("downsample_level is {}; use 0 (full resolution) to {}",
                                             requested.downsample_level(), kMaxDownsampleLevel));
            return false;
        case v1::STREAM_KIND_SILHOUETTE:
            topic = {Topic::Kind::kSilhouette, 0, requested.camera()};
            if (!requested.camera().empty() && requested.camera().size() <= kMaxName_bytes) return true;
            error = stream_error("INVALID_ARGUMENT",
                                 "camera is missing; a silhouette needs a camera name from the status");
            return false;
        case v1::STREAM_KIND_IMAGE:
            error = stream_error(
                "PERMISSION_DENIED",
                "camera images are never sent to browsers; subscribe to poses, volumes or silhouettes");
            return false;
        default:
            error = stream_error(
                "INVALID_ARGUMENT",
                fmt::format("unknown stream kind {}; subscribe to poses, volumes, status or silhouettes",
                            static_cast<int>(requested.kind())));
            return false;
    }
}

bool carries_unknown_fields(const google::protobuf::Message& message) {
    return message.GetReflection()->GetUnknownFields(message).field_count() > 0;
}

// A message may be early by this fraction of its period: 25 Hz of a jittering 25 Hz stream loses none.
constexpr double kEarlyFraction = 0.2;

}  // namespace

SubscriptionRequest parse_subscriptions(std::string_view bytes) {
    v1::BrowserMessage message;
    if (bytes.size() > kMaxBrowserMessage_bytes ||
        !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
        return invalid_request(fmt::format(
            "{} bytes are not a BrowserMessage (proto/kinevox/web/v1/exhibit.proto)", bytes.size()));
    if (carries_unknown_fields(message) ||
        std::ranges::any_of(message.subscriptions(), carries_unknown_fields))
        return invalid_request("unknown field: page and gateway have different versions; reload the page");
    if (message.subscriptions_size() > kMaxSubscriptions)
        return invalid_request(fmt::format("{} subscriptions; the maximum is {}",
                                           message.subscriptions_size(), kMaxSubscriptions));
    SubscriptionRequest out;
    for (const v1::StreamSubscription& requested : message.subscriptions()) {
        const double rate_hz = requested.max_rate_hz();
        Subscription subscription{{}, rate_hz};
        v1::StreamError error;
        bool accepted = parse_topic(requested, subscription.topic, error);
        if (accepted && rate_hz != 0 && !(rate_hz >= kMinRate_hz && rate_hz <= kMaxRate_hz)) {  // NaN, too
            error = stream_error("INVALID_ARGUMENT",
                                 fmt::format("max_rate_hz is {}; use {} to {}, or 0 for no limit", rate_hz,
                                             kMinRate_hz, kMaxRate_hz));
            accepted = false;
        }
        if (!accepted) {
            *error.mutable_subscription() = requested;
            out.errors.push_back(std::move(error));
            continue;
        }
        const bool duplicate = std::ranges::any_of(
            out.accepted, [&](const Subscription& other) { return other.topic == subscription.topic; });
        if (!duplicate) out.accepted.push_back(std::move(subscription));
    }
    return out;
}

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
