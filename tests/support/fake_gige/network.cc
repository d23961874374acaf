#include "tests/support/fake_gige/network.h"

#include <sys/socket.h>

#include <algorithm>
#include <set>

#include "tests/support/fake_gige/wire.h"

namespace kinevox::testing {

LossyNetwork::LossyNetwork(int socket, const NetworkOptions& options)
    : socket_(socket), options_(options), random_(options.seed) {}

void LossyNetwork::put(const std::shared_ptr<SentPicture>& picture, std::uint32_t number,
                       std::int64_t due_ns) {
    ++counts_.packets;
    if (options_.loss > 0 && draw() < options_.loss) {
        ++counts_.packets_lost;
        return;
    }
    if (options_.reorder_ms > 0) due_ns += static_cast<std::int64_t>(draw() * options_.reorder_ms * 1e6);
    waiting_.push({due_ns, order_++, picture, number});
}

std::int64_t LossyNetwork::queued_until(std::int64_t now_ns) {
    last_due_ns_ =
        std::max(last_due_ns_, now_ns + static_cast<std::int64_t>(draw() * options_.jitter_ms * 1e6));
    return last_due_ns_;
}

void LossyNetwork::send(std::shared_ptr<SentPicture> picture, std::int64_t now_ns) {
    picture->gone = options_.lost_pictures > 0 && draw() < options_.lost_pictures;
    if (picture->gone) {
        ++counts_.pictures_gone;
        return;
    }
    const std::int64_t due_ns = queued_until(now_ns);
    for (std::uint32_t n = 0; n < picture->packets(); ++n) put(picture, n, due_ns);
}

void LossyNetwork::resend(const std::shared_ptr<SentPicture>& picture, std::uint32_t first,
                          std::uint32_t last, std::int64_t now_ns) {
    if (picture->gone) return;
    for (std::uint32_t n = first; n <= std::min(last, picture->packets() - 1); ++n) {
        ++counts_.resent;
        put(picture, n, queued_until(now_ns));
    }
}

std::optional<std::int64_t> LossyNetwork::run(std::int64_t now_ns) {
    while (!waiting_.empty() && waiting_.top().due_ns <= now_ns) {
        transmit(waiting_.top());
        waiting_.pop();
    }
    if (waiting_.empty()) return std::nullopt;
    return waiting_.top().due_ns;
}

void LossyNetwork::forget() {
    std::set<const SentPicture*> under_way;
    for (; !waiting_.empty(); waiting_.pop()) under_way.insert(waiting_.top().picture.get());
    counts_.under_way += under_way.size();
}

void LossyNetwork::transmit(const Packet& packet) {
    const SentPicture& picture = *packet.picture;
    constexpr std::uint32_t kLeader = 1, kTrailer = 2, kPayload = 3, kImage = 1;
    const bool leader = packet.number == 0, trailer = packet.number + 1 == picture.packets();
    buffer_.clear();
    Wire wire(buffer_);
    wire.u16(0)
        .u16(picture.block)
        .u32((leader    ? kLeader
              : trailer ? kTrailer
                        : kPayload)
                 << 24 |
             packet.number);
    if (leader) {
        wire.u16(0).u16(kImage).u32(static_cast<std::uint32_t>(picture.timestamp_ns >> 32));
        wire.u32(static_cast<std::uint32_t>(picture.timestamp_ns)).u32(picture.pixel_format);
        wire.u32(picture.width).u32(picture.height).u32(0).u32(0).u16(0).u16(0);
    } else if (trailer) {
        wire.u16(0).u16(kImage).u32(picture.height);
    } else {
        const std::size_t begin = (packet.number - 1) * picture.packet_payload;
        const std::size_t bytes = std::min(picture.packet_payload, picture.bytes->size() - begin);
        wire.bytes({picture.bytes->data() + begin, bytes});
    }
    // A full socket loses the packet, as a switch would.
    if (sendto(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT,
               reinterpret_cast<const sockaddr*>(&picture.to), sizeof picture.to) < 0)
        ++counts_.packets_lost;
}

}  // namespace kinevox::testing
