// Encodes frame sets on their way from the capture to the recorder's files: one thread per camera.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "server/cameras/frame_source.h"
#include "server/recording/image_encoder.h"

namespace kinevox {

// A frame set with its encoded images.
struct EncodedSet {
    std::uint64_t number = 0;          // counts the sets taken, without gaps
    std::uint64_t run = 0;             // of the capture; sequences are unique within a run
    std::uint64_t sequence = 0;        // at the source
    std::int64_t capture_time_ns = 0;  // of the source
    std::int64_t capture_time_utc_ns = 0;
    bool key = false;  // all images can be decoded without earlier ones
    std::vector<std::shared_ptr<const EncodedImage>> images;  // per camera
    std::size_t raw_bytes = 0;                                // before encoding
    absl::Status status;                                      // of the encoding; not OK: images are missing

    std::size_t bytes() const;
};

// put() by one thread. `on_done` is called in the order of put(), one call at a time, on a lane's thread.
// Unbounded: the caller limits the number of pending sets.
class EncodingLanes {
  public:
    using OnDone = std::function<void(std::shared_ptr<EncodedSet>)>;

    static absl::StatusOr<std::unique_ptr<EncodingLanes>> create(const std::vector<Camera>& cameras,
                                                                 double fps, VideoCodec codec,
                                                                 OnDone on_done);
    ~EncodingLanes();  // discards pending sets

    // Each of `images` is released as soon as it is encoded.
    void put(std::shared_ptr<EncodedSet> set, std::vector<Image> images);
    std::vector<VideoFormat> formats() const;

  private:
    struct Job;
    struct Lane {
        std::unique_ptr<ImageEncoder> encoder;
        std::deque<std::shared_ptr<Job>> jobs;
        std::jthread thread;
    };
    void encode(Lane& lane, std::size_t camera, const std::stop_token& stop);

    OnDone on_done_;
    std::mutex mutex_;  // guards the lanes' jobs
    std::condition_variable_any changed_;
    std::deque<Lane> lanes_;
};

}  // namespace kinevox
