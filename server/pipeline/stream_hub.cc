#include "server/pipeline/stream_hub.h"

#include <algorithm>

#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

// The mailboxes still held by their subscribers; forgets the others.
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
    if (!published.volume) return sizeof published;
    return sizeof published + published.volume->bricks.size() * sizeof(VolumeBrick) +
           published.volume->colours.size() * sizeof(Rgb);
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

std::shared_ptr<PictureMailbox> StreamHub::subscribe_pictures(std::function<void()> on_ready) {
    return subscribe(pictures_, MailboxOptions{}, std::move(on_ready));
}

std::shared_ptr<EventMailbox> StreamHub::subscribe_events(std::size_t past, std::function<void()> on_ready) {
    auto box =
        std::make_shared<EventMailbox>(MailboxOptions{.max_messages = kQueuedEvents}, std::move(on_ready));
    const std::scoped_lock lock(mutex_);
    const std::size_t count = std::min(past, past_events_.size());
    for (std::size_t i = past_events_.size() - count; i < past_events_.size(); ++i) box->put(past_events_[i]);
    if (!closed_.ok()) box->close(closed_);
    events_.push_back(box);
    return box;
}

void StreamHub::publish(const FrameResultPtr& result, std::int64_t utc_minus_capture_ns) {
    auto pictures = std::make_shared<PublishedPictures>();
    pictures->result = result;
    pictures->capture_time_utc_ns = result->capture_time_ns + utc_minus_capture_ns;
    pictures->published_utc_ns = utc_now_ns();
    pictures->published_at = std::chrono::steady_clock::now();

    std::vector<std::shared_ptr<VolumeMailbox>> volume_boxes;
    std::vector<std::shared_ptr<PoseMailbox>> pose_boxes;
    std::vector<std::shared_ptr<PictureMailbox>> picture_boxes;
    std::shared_ptr<const PublishedPictures> previous;  // its pictures are freed outside the lock
    {
        const std::scoped_lock lock(mutex_);
        volume_boxes = alive(volumes_);
        pose_boxes = alive(poses_);
        picture_boxes = alive(pictures_);
        previous = std::exchange(newest_, pictures);
    }
    if (!volume_boxes.empty()) {
        auto published = std::make_shared<PublishedVolume>();
        published->header = pictures->header();
        published->volume = result->volume;
        if (result->volume) published->litres = volume_litres(*result->volume);
        const std::size_t bytes = size_in_memory(*published);
        for (const auto& box : volume_boxes) box->put(published, bytes);
    }
    if (!pose_boxes.empty()) {
        const auto published = std::make_shared<PublishedPose>();
        published->header = pictures->header();
        published->pose = result->pose;
        for (const auto& box : pose_boxes) box->put(published, sizeof(PublishedPose) + sizeof(BodyPose));
    }
    for (const auto& box : picture_boxes) box->put(pictures);
    for (const Event& event : result->events)
        publish_event(event, pictures->capture_time_utc_ns,
                      result->subject ? result->subject->subject_id : 0);
}

void StreamHub::publish_event(Event event, std::int64_t time_utc_ns, std::uint32_t subject_id) {
    PublishedEvent published{0, time_utc_ns, subject_id, std::move(event)};
    const std::scoped_lock lock(mutex_);  // held while posting, so that all see the same order
    published.number = ++event_count_;
    past_events_.push_back(published);
    if (past_events_.size() > kPastEvents) past_events_.pop_front();
    for (const auto& box : alive(events_)) box->put(published);
}

std::shared_ptr<const PublishedPictures> StreamHub::newest() const {
    const std::scoped_lock lock(mutex_);
    return newest_;
}

void StreamHub::close(const absl::Status& why) {
    std::vector<std::shared_ptr<VolumeMailbox>> volumes;
    std::vector<std::shared_ptr<PoseMailbox>> poses;
    std::vector<std::shared_ptr<PictureMailbox>> pictures;
    std::vector<std::shared_ptr<EventMailbox>> events;
    {
        const std::scoped_lock lock(mutex_);
        closed_ = why;
        volumes = alive(volumes_);
        poses = alive(poses_);
        pictures = alive(pictures_);
        events = alive(events_);
    }
    for (const auto& box : volumes) box->close(why);
    for (const auto& box : poses) box->close(why);
    for (const auto& box : pictures) box->close(why);
    for (const auto& box : events) box->close(why);
}

StreamHub::Subscribers StreamHub::subscribers() const {
    const std::scoped_lock lock(mutex_);
    return {count_alive(volumes_), count_alive(poses_), count_alive(pictures_), count_alive(events_)};
}

}  // namespace kinevox
