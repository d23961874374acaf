#include "tests/support/fake_gige/network.h"

#include <sys/socket.h>

#include <algorithm>
#include <set>

#include "tests/support/fake_gige/wire.h"

namespace kinevox::testing {

LossyNetwork::LossyNetwork(int socket, const NetworkOptions& options)
    : socket_(socket), options_(options), random_(options.seed) {}

void LossyNetwork::put(const std::shared_ptr<SentImage>& image, std::uint32_t number, std::int64_t due_ns) {
    ++counts_.packets;
    if (options_.loss > 0 && draw() < options_.loss) {
        ++counts_.packets_lost;
        return;
    }
    if (options_.reorder_ms > 0) due_ns += static_cast<std::int64_t>(draw() * options_.reorder_ms * 1e6);
    waiting_.push({due_ns, order_++, image, number});
}

std::int64_t LossyNetwork::queued_until(std::int64_t now_ns) {
    last_due_ns_ =
        std::max(last_due_ns_, now_ns + static_cast<std::int64_t>(draw() * options_.jitter_ms * 1e6));
    return last_due_ns_;
}

void LossyNetwork::send(std::shared_ptr<SentImage> image, std::int64_t now_ns) {
    image->gone = options_.lost_images > 0 && draw() < options_.lost_images;
    if (image->gone) {
        ++counts_.images_gone;
        return;
    }
    const std::int64_t due_ns = queued_until(now_ns);
    for (std::uint32_t n = 0; n < image->packets(); ++n) put(image, n, due_ns);
}

void LossyNetwork::resend(const std::shared_ptr<SentImage>& image, std::uint32_t first, std::uint32_t last,
                          std::int64_t now_ns) {
    if (image->gone) return;
    for (std::uint32_t n = first; n <= std::min(last, image->packets() - 1); ++n) {
        ++counts_.resent;
        put(image, n, queued_until(now_ns));
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
    std::set<const SentImage*> under_way;
    for (; !waiting_.empty(); waiting_.pop()) under_way.insert(waiting_.top().image.get());
    counts_.under_way += under_way.size();
}

void LossyNetwork::transmit(const Packet& packet) {
    const SentImage& image = *packet.image;
    constexpr std::uint32_t kLeader = 1, kTrailer = 2, kPayload = 3, kImage = 1;
    const bool leader = packet.number == 0, trailer = packet.number + 1 == image.packets();
    buffer_.clear();
    Wire wire(buffer_);
    wire.u16(0)
        .u16(image.block)
        .u32((leader    ? kLeader
              : trailer ? kTrailer
                        : kPayload)
                 << 24 |
             packet.number);
    if (leader) {
        wire.u16(0).u16(kImage).u32(static_cast<std::uint32_t>(image.timestamp_ns >> 32));
        wire.u32(static_cast<std::uint32_t>(image.timestamp_ns)).u32(image.pixel_format);
        wire.u32(image.width).u32(image.height).u32(0).u32(0).u16(0).u16(0);
    } else if (trailer) {
        wire.u16(0).u16(kImage).u32(image.height);
    } else {
        const std::size_t begin = (packet.number - 1) * image.packet_payload;
        const std::size_t bytes = std::min(image.packet_payload, image.bytes->size() - begin);
        wire.bytes({image.bytes->data() + begin, bytes});
    }
    // A full socket loses the packet, as a switch would.
    if (sendto(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT,
               reinterpret_cast<const sockaddr*>(&image.to), sizeof image.to) < 0)
        ++counts_.packets_lost;
}

}  // namespace kinevox::testing
