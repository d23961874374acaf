#include "client/web/wants.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace kinevox::web {
namespace {

constexpr int kMaxLevel = 5;
constexpr double kMinRate_hz = 0.001, kMaxRate_hz = 1000;
constexpr std::size_t kMaxName_bytes = 100;

v1::Refusal refusal(const char* code, std::string message) {
    v1::Refusal out;
    out.set_code(code);
    out.set_message(std::move(message));
    return out;
}

Wants not_understood(std::string message) {
    Wants out;
    out.understood = false;
    out.refused.push_back(refusal("INVALID_ARGUMENT", std::move(message)));
    return out;
}

// The topic, or the refusal's words.
bool read_topic(const v1::Want& want, Topic& topic, v1::Refusal& why) {
    switch (want.kind()) {
        case v1::KIND_POSES:
            topic = {Topic::Kind::kPoses, 0, {}};
            return true;
        case v1::KIND_STATUS:
            topic = {Topic::Kind::kStatus, 0, {}};
            return true;
        case v1::KIND_VOLUMES:
            topic = {Topic::Kind::kVolumes, want.level(), {}};
            if (want.level() >= 0 && want.level() <= kMaxLevel) return true;
            why = refusal("INVALID_ARGUMENT", fmt::format("level is {}; ask for 0, full resolution, to {}",
                                                          want.level(), kMaxLevel));
            return false;
        case v1::KIND_SILHOUETTE:
            topic = {Topic::Kind::kSilhouette, 0, want.camera()};
            if (!want.camera().empty() && want.camera().size() <= kMaxName_bytes) return true;
            why = refusal("INVALID_ARGUMENT", "a silhouette needs camera, a name that the status lists");
            return false;
        case v1::KIND_PICTURE:
            why =
                refusal("PERMISSION_DENIED",
                        "camera pictures are never given to browsers; ask for poses, volumes or silhouettes");
            return false;
        default:
            why = refusal("INVALID_ARGUMENT",
                          fmt::format("kind {} is not known; ask for poses, volumes, status or a silhouette",
                                      static_cast<int>(want.kind())));
            return false;
    }
}

bool carries_unknown_fields(const google::protobuf::Message& message) {
    return message.GetReflection()->GetUnknownFields(message).field_count() > 0;
}

}  // namespace

Wants read_wants(std::string_view bytes) {
    v1::BrowserMessage message;
    if (bytes.size() > kMaxBrowserMessage_bytes ||
        !message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
        return not_understood(fmt::format(
            "{} bytes that are no BrowserMessage (proto/kinevox/web/v1/exhibit.proto)", bytes.size()));
    if (carries_unknown_fields(message) || std::ranges::any_of(message.wants(), carries_unknown_fields))
        return not_understood(
            "a field that this gateway does not know; page and gateway are of different versions");
    if (message.wants_size() > kMaxWants)
        return not_understood(fmt::format("{} wants; ask for {} at most", message.wants_size(), kMaxWants));
    Wants out;
    for (const v1::Want& want : message.wants()) {
        const double rate_hz = want.max_rate_hz();
        Subscription subscription{{}, rate_hz};
        v1::Refusal why;
        bool granted = read_topic(want, subscription.topic, why);
        if (granted && rate_hz != 0 && !(rate_hz >= kMinRate_hz && rate_hz <= kMaxRate_hz)) {  // NaN, too
            why =
                refusal("INVALID_ARGUMENT", fmt::format("max_rate_hz is {}; ask for {} to {}, or 0, no limit",
                                                        rate_hz, kMinRate_hz, kMaxRate_hz));
            granted = false;
        }
        if (!granted) {
            *why.mutable_want() = want;
            out.refused.push_back(std::move(why));
            continue;
        }
        const bool twice = std::ranges::any_of(
            out.granted, [&](const Subscription& other) { return other.topic == subscription.topic; });
        if (!twice) out.granted.push_back(std::move(subscription));
    }
    return out;
}

}  // namespace kinevox::web
