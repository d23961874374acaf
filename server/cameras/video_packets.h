// Video packets of a container in decoding order, starting at any key. Only for .cc files: FFmpeg's types.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "server/cameras/libav.h"

namespace kinevox {

// A packet at which decoding can start.
struct KeyPacket {
    std::int64_t packets_before = 0;
    std::int64_t images_before = 0;  // visible ones among these
    std::int64_t timestamp = 0;      // decoding time from the container's index, otherwise presentation time
};

// Used by one thread at a time.
class VideoPackets {
  public:
    // InvalidArgument, starting with `whose`, if the file contains no readable video.
    static absl::StatusOr<std::unique_ptr<VideoPackets>> open(const std::filesystem::path& file,
                                                              const std::string& whose);

    // For the decoder; valid until the next restart() or go_to().
    const AVCodecParameters& parameters() const { return *stream_->codecpar; }
    const AVCodec* decoder() const { return decoder_; }
    // Clockwise rotation that makes the images upright: 0, 90, 180 or 270 degrees.
    int rotation_deg() const;

    // Number of images; -1 if unknown. Exact if the container has an index.
    std::int64_t promised() const { return promised_; }
    bool promise_is_exact() const { return exact_; }

    // FFmpeg's code; AVERROR_EOF at the end.
    int next(AVPacket* packet);

    // Back to the first packet.
    absl::Status restart();

    // Finds the keys, once: in the container's index, or by reading the file. False if a packet is not
    // exactly one image or the first is not a key: then only restart() is exact.
    absl::StatusOr<bool> index();
    const std::vector<KeyPacket>& keys() const { return keys_; }  // after index()
    std::int64_t images() const { return images_; }               // visible ones; after index()

    // Seeks to the packet of a key of keys(). Requires that index() returned true.
    absl::Status go_to(const KeyPacket& key);

  private:
    VideoPackets(const std::filesystem::path& file, std::string whose)
        : file_(file.string()), whose_(std::move(whose)) {}
    bool read_container_index();
    absl::Status read_through();
    std::int64_t timestamp_of(const AVPacket& packet) const;  // as KeyPacket::timestamp
    std::optional<std::int64_t> lead_to(const KeyPacket& wanted, std::int64_t timestamp);

    std::string file_, whose_;
    libav::OwnedInput container_;
    AVStream* stream_ = nullptr;
    const AVCodec* decoder_ = nullptr;
    std::int64_t promised_ = -1, images_ = 0;
    bool exact_ = false;
    bool of_container_ = false;  // has an index of all packets
    bool indexed_ = false, usable_ = false;
    std::vector<KeyPacket> keys_;
    libav::Owned<AVPacket> held_;  // delivered by next() first; empty: none
    bool holds_ = false;
};

}  // namespace kinevox
