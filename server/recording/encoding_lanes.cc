#include "server/recording/encoding_lanes.h"

#include <atomic>
#include <utility>

namespace kinevox {

struct EncodingLanes::Job {
    std::shared_ptr<EncodedSet> set;
    std::vector<Image> images;           // each lane's own
    std::vector<absl::Status> statuses;  // likewise
    std::atomic<std::size_t> remaining{0};
};

std::size_t EncodedSet::bytes() const {
    std::size_t bytes = 0;
    for (const auto& image : images) bytes += image ? image->bytes.size() : 0;
    return bytes;
}

absl::StatusOr<std::unique_ptr<EncodingLanes>> EncodingLanes::create(const std::vector<Camera>& cameras,
                                                                     double fps, VideoCodec codec,
                                                                     OnDone on_done) {
    auto lanes = std::make_unique<EncodingLanes>();
    lanes->on_done_ = std::move(on_done);
    for (const Camera& camera : cameras) {
        auto encoder = ImageEncoder::create(camera, fps, codec);
        if (!encoder.ok()) return encoder.status();
        lanes->lanes_.emplace_back().encoder = *std::move(encoder);
    }
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        Lane& lane = lanes->lanes_[c];
        lane.thread = std::jthread(
            [self = lanes.get(), &lane, c](const std::stop_token& stop) { self->encode(lane, c, stop); });
    }
    return lanes;
}

EncodingLanes::~EncodingLanes() {
    for (Lane& lane : lanes_) lane.thread.request_stop();
    for (Lane& lane : lanes_)
        if (lane.thread.joinable()) lane.thread.join();
}

std::vector<VideoFormat> EncodingLanes::formats() const {
    std::vector<VideoFormat> formats;
    for (const Lane& lane : lanes_) formats.push_back(lane.encoder->format());
    return formats;
}

void EncodingLanes::put(std::shared_ptr<EncodedSet> set, std::vector<Image> images) {
    auto job = std::make_shared<Job>();
    job->set = std::move(set);
    job->images = std::move(images);
    job->images.resize(lanes_.size());
    job->set->images.resize(lanes_.size());
    job->statuses.resize(lanes_.size());
    job->remaining = lanes_.size();
    const std::scoped_lock lock(mutex_);
    for (Lane& lane : lanes_) lane.jobs.push_back(job);
    changed_.notify_all();
}

void EncodingLanes::encode(Lane& lane, std::size_t camera, const std::stop_token& stop) {
    // At the capture's priority: a delayed result arrives a few milliseconds later, a dropped image never.
    for (;;) {
        std::shared_ptr<Job> job;
        {
            std::unique_lock lock(mutex_);
            if (!changed_.wait(lock, stop, [&] { return !lane.jobs.empty(); }) || stop.stop_requested())
                return;
            job = std::move(lane.jobs.front());
            lane.jobs.pop_front();
        }
        auto encoded = lane.encoder->encode(job->images[camera], job->set->key);
        job->images[camera] = {};
        if (encoded.ok())
            job->set->images[camera] = *std::move(encoded);
        else
            job->statuses[camera] = encoded.status();
        // The last lane of a set has not started the next one, so sets finish in order.
        if (--job->remaining > 0) continue;
        for (const absl::Status& status : job->statuses) job->set->status.Update(status);
        on_done_(job->set);
    }
}

}  // namespace kinevox
