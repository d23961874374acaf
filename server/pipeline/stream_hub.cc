#include "server/pipeline/stream_hub.h"

#include <algorithm>

#include "common/utc_clock.h"

namespace kinevox {
namespace {

// The mailboxes that subscribers still hold; removes the others.
template <typename Box>
std::vector<std::shared_ptr<Box>> alive(std::vector<std::weak_ptr<Box>>& boxes) {
    std::vector<std::shared_ptr<Box>> found;
    std::erase_if(boxes, [&](const std::weak_ptr<Box>& weak) {
        std::shared_ptr<Box> box = weak.lock();
        if (!box) return true;
        found.push_back(std::move(box));
        return false;
    });
    return found;
}

template <typename Box>
int count_alive(const std::vector<std::weak_ptr<Box>>& boxes) {
    return static_cast<int>(std::ranges::count_if(boxes, [](const auto& weak) { return !weak.expired(); }));
}

std::size_t size_in_memory(const PublishedVolume& published) {
    std::size_t bytes = sizeof published;
    for (const PublishedVolume::Subject& subject : published.subjects) {
        bytes += sizeof subject;
        if (subject.volume)
            bytes += subject.volume->bricks.size() * sizeof(VolumeBrick) +
                     subject.volume->colours.size() * sizeof(Rgb);
    }
    return bytes;
}

}  // namespace

template <typename Box>
std::shared_ptr<Box> StreamHub::subscribe(std::vector<std::weak_ptr<Box>>& boxes,
                                          const MailboxOptions& options, std::function<void()> on_ready) {
    auto box = std::make_shared<Box>(options, std::move(on_ready));
    const std::scoped_lock lock(mutex_);
    if (!closed_.ok()) box->close(closed_);
    boxes.push_back(box);
    return box;
}

std::shared_ptr<VolumeMailbox> StreamHub::subscribe_volumes(const MailboxOptions& options,
                                                            std::function<void()> on_ready) {
    return subscribe(volumes_, options, std::move(on_ready));
}

std::shared_ptr<PoseMailbox> StreamHub::subscribe_poses(const MailboxOptions& options,
                                                        std::function<void()> on_ready) {
    return subscribe(poses_, options, std::move(on_ready));
}

std::shared_ptr<ImageMailbox> StreamHub::subscribe_images(std::function<void()> on_ready) {
    return subscribe(images_, MailboxOptions{}, std::move(on_ready));
}

void StreamHub::publish(const FrameResultPtr& result, std::int64_t utc_minus_capture_ns) {
    auto images = std::make_shared<PublishedImages>();
    images->result = result;
    images->capture_time_utc_ns = result->capture_time_ns + utc_minus_capture_ns;
    images->published_utc_ns = utc_now_ns();
    images->published_at = std::chrono::steady_clock::now();

    std::vector<std::shared_ptr<VolumeMailbox>> volume_boxes;
    std::vector<std::shared_ptr<PoseMailbox>> pose_boxes;
    std::vector<std::shared_ptr<ImageMailbox>> image_boxes;
    std::shared_ptr<const PublishedImages> previous;  // its images are freed outside the lock
    {
        const std::scoped_lock lock(mutex_);
        volume_boxes = alive(volumes_);
        pose_boxes = alive(poses_);
        image_boxes = alive(images_);
        previous = std::exchange(latest_, images);
    }
    if (!volume_boxes.empty()) {
        auto published = std::make_shared<PublishedVolume>();
        published->header = images->header();
        for (const SubjectResult& subject : result->subjects)
            published->subjects.push_back(
                {subject.track, subject.volume, subject.volume ? volume_litres(*subject.volume) : 0});
        const std::size_t bytes = size_in_memory(*published);
        for (const auto& box : volume_boxes) box->put(published, bytes);
    }
    if (!pose_boxes.empty()) {
        const auto published = std::make_shared<PublishedPose>();
        published->header = images->header();
        for (const SubjectResult& subject : result->subjects)
            published->subjects.push_back({subject.track.subject_id, subject.pose, subject.track.name});
        const std::size_t bytes =
            sizeof(PublishedPose) + std::max<std::size_t>(1, published->subjects.size()) *
                                        (sizeof(PublishedPose::Subject) + sizeof(BodyPose));
        for (const auto& box : pose_boxes) box->put(published, bytes);
    }
    for (const auto& box : image_boxes) box->put(images);
    for (const Event& event : result->events)
        events_.publish(event, images->capture_time_utc_ns,
                        result->subjects.size() == 1 ? result->subjects.front().track.subject_id : 0);
}

std::shared_ptr<const PublishedImages> StreamHub::latest() const {
    const std::scoped_lock lock(mutex_);
    return latest_;
}

void StreamHub::close(const absl::Status& why) {
    std::vector<std::shared_ptr<VolumeMailbox>> volumes;
    std::vector<std::shared_ptr<PoseMailbox>> poses;
    std::vector<std::shared_ptr<ImageMailbox>> images;
    {
        const std::scoped_lock lock(mutex_);
        closed_ = why;
        volumes = alive(volumes_);
        poses = alive(poses_);
        images = alive(images_);
    }
    for (const auto& box : volumes) box->close(why);
    for (const auto& box : poses) box->close(why);
    for (const auto& box : images) box->close(why);
    events_.close(why);
}

StreamHub::Subscribers StreamHub::subscribers() const {
    const std::scoped_lock lock(mutex_);
    return {count_alive(volumes_), count_alive(poses_), count_alive(images_), events_.subscriber_count()};
}

}  // namespace kinevox
