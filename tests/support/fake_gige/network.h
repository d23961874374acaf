// A bad network below the fake camera: packets are lost, late and out of order, by a seed.
#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <queue>
#include <random>
#include <vector>

namespace kinevox::testing {

struct NetworkOptions {
    double loss = 0;         // fraction of packets that never arrive, 0..1
    double lost_images = 0;  // fraction of images of which nothing arrives, not even on request
    double jitter_ms = 0;  // maximum delay of an image's packets, random per image; packets stay in order, as
                           // in the queue of a switch
    double reorder_ms = 0;  // maximum delay per packet, so that packets arrive out of order
    std::uint32_t seed = 1;
};

// A image on its way: its bytes, shared, and what its packets say.
struct SentImage {
    std::uint16_t block = 0;
    std::uint64_t timestamp_ns = 0;
    std::uint32_t pixel_format = 0, width = 0, height = 0;
    std::size_t packet_payload = 0;
    std::shared_ptr<const std::vector<std::uint8_t>> bytes;
    sockaddr_in to{};
    bool gone = false;  // of lost_images

    std::uint32_t packets() const {  // leader, data, trailer
        return static_cast<std::uint32_t>((bytes->size() + packet_payload - 1) / packet_payload) + 2;
    }
};

struct NetworkCounts {
    std::uint64_t images_gone = 0, packets = 0, packets_lost = 0, resent = 0;
    std::uint64_t under_way = 0;  // images that were forgotten before all of their packets had left
};

class LossyNetwork {
  public:
    LossyNetwork(int socket, const NetworkOptions& options);

    void send(std::shared_ptr<SentImage> image, std::int64_t now_ns);
    void resend(const std::shared_ptr<SentImage>& image, std::uint32_t first, std::uint32_t last,
                std::int64_t now_ns);
    // Sends what is due; returns when the next is.
    std::optional<std::int64_t> run(std::int64_t now_ns);
    void forget();  // everything under way
    const NetworkCounts& counts() const { return counts_; }

  private:
    struct Packet {
        std::int64_t due_ns;
        std::uint64_t order;
        std::shared_ptr<SentImage> image;
        std::uint32_t number;
        bool operator<(const Packet& other) const {  // the earliest on top
            return due_ns != other.due_ns ? due_ns > other.due_ns : order > other.order;
        }
    };
    void put(const std::shared_ptr<SentImage>& image, std::uint32_t number, std::int64_t due_ns);
    std::int64_t queued_until(std::int64_t now_ns);
    void transmit(const Packet& packet);
    double draw() { return std::uniform_real_distribution<double>(0, 1)(random_); }

    const int socket_;
    const NetworkOptions options_;
    std::mt19937 random_;
    std::priority_queue<Packet> waiting_;
    std::uint64_t order_ = 0;
    std::int64_t last_due_ns_ = 0;  // of the queue
    std::vector<std::uint8_t> buffer_;
    NetworkCounts counts_;
};

}  // namespace kinevox::testing
