// What a browser may ask for. Here, and nowhere else, is decided what is refused.
#pragma once

#include <compare>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "kinevox/web/v1/exhibit.pb.h"

namespace kinevox::web {

// One stream of the daemon, shared by all browsers that want it. There is no kind for camera pictures.
struct Topic {
    enum class Kind : std::uint8_t { kPoses, kVolumes, kStatus, kSilhouette };
    Kind kind = Kind::kPoses;
    int level = 0;       // of volumes
    std::string camera;  // of a silhouette
    auto operator<=>(const Topic&) const = default;
};

struct Subscription {
    Topic topic;
    double max_rate_hz = 0;  // 0: no limit
};

struct Wants {
    std::vector<Subscription> granted;  // each topic once
    std::vector<web::v1::Refusal> refused;
    bool understood = true;  // else `granted` says nothing, and what was asked before holds
};

inline constexpr std::size_t kMaxBrowserMessage_bytes = 4096;
inline constexpr int kMaxWants = 16;

// One message of a browser, as it came.
Wants read_wants(std::string_view bytes);

}  // namespace kinevox::web
