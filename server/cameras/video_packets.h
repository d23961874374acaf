// A container's packets of video in the order of decoding, from any key on. For .cc files alone: FFmpeg's
// types.
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

// Where decoding may begin.
struct KeyPacket {
    std::int64_t packets_before = 0;
    std::int64_t pictures_before = 0;  // of these, such as are shown
    std::int64_t timestamp = 0;        // of its decoding, from the container's index; else when it is shown
};

// Used by one thread at a time.
class VideoPackets {
  public:
    // InvalidArgument, with `whose` at its begin, where the file holds no video that can be read.
    static absl::StatusOr<std::unique_ptr<VideoPackets>> open(const std::filesystem::path& file,
                                                              const std::string& whose);

    // For the decoder; valid until the next restart() or go_to().
    const AVCodecParameters& parameters() const { return *stream_->codecpar; }
    const AVCodec* decoder() const { return decoder_; }
    // By how much the pictures are to be turned clockwise to be upright: 0, 90, 180 or 270 degrees.
    int turn_deg() const;

    // Pictures; -1 where the container does not say. Exact where it keeps an index of them.
    std::int64_t promised() const { return promised_; }
    bool promise_is_exact() const { return exact_; }

    // FFmpeg's code; AVERROR_EOF at the end.
    int next(AVPacket* packet);

    // Ready for next(): the first packet.
    absl::Status restart();

    // Finds the keys, once: in the container's index, or by reading the file through. False where packets are
    // no pictures one by one, or the first is no key: then only restart() leads anywhere exactly.
    absl::StatusOr<bool> index();
    const std::vector<KeyPacket>& keys() const { return keys_; }  // after index()
    std::int64_t pictures() const { return pictures_; }           // shown; after index()

    // Ready for next(): that key's packet; one of keys(). After index() gave true.
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
    std::int64_t promised_ = -1, pictures_ = 0;
    bool exact_ = false;
    bool of_container_ = false;  // it keeps an index of all packets
    bool indexed_ = false, usable_ = false;
    std::vector<KeyPacket> keys_;
    libav::Owned<AVPacket> held_;  // what next() delivers first; empty: none
    bool holds_ = false;
};

}  // namespace kinevox
