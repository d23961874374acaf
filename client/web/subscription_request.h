// The streams a browser may subscribe to. This is the only place that rejects subscriptions.
#pragma once

#include <compare>
#include <cstdint>
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

// Parses one BrowserMessage as received.
SubscriptionRequest parse_subscriptions(std::string_view bytes);

}  // namespace kinevox::web
