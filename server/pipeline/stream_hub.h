// Hands each result to everyone who subscribed, without ever making the pipeline wait.
#pragma once

#include <absl/status/status.h>

#include <chrono>
#include <compare>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "common/body_pose.h"
#include "common/volume.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/mailbox.h"
#include "server/pipeline/once_map.h"

namespace kinevox {

// In which form a subscriber wants the volume.
struct VolumeForm {
    int level = 0;  // halvings of the resolution
    bool with_colours = true;
    auto operator<=>(const VolumeForm&) const = default;
};

// In which form a subscriber wants a preview.
struct PreviewForm {
    std::size_t camera = 0;  // its place in the frame set
    bool silhouette = false;
    int max_width_px = 320;
    int max_height_px = 0;  // 0: no limit
    int jpeg_quality = 80;
    auto operator<=>(const PreviewForm&) const = default;
};

// What every published message says first.
struct PublishedHeader {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_utc_ns = 0;
    StageTimes times;
    std::optional<SubjectTrack> subject;
    std::optional<std::int64_t> recorded_frame;  // of a replay
    std::int64_t published_utc_ns = 0;
    std::chrono::steady_clock::time_point published_at;  // the same, whatever becomes of the machine's clock
};

// A message's bytes as they are sent, the same for all subscribers who ask for one form. Made on demand by
// whoever needs them first, never on the pipeline's thread.
template <typename Form>
using Encodings = OnceMap<Form, std::string>;

// A result without its pictures, which a queue may hold many of.
struct PublishedVolume {
    PublishedHeader header;
    std::shared_ptr<const Volume> volume;  // null while nobody is tracked
    double litres = 0;
    Encodings<VolumeForm> encodings;
};

// A result's pose alone: small, so that a queue may hold very many.
struct PublishedPose {
    PublishedHeader header;
    std::shared_ptr<const BodyPose> pose;  // null where there is none
    Encodings<std::monostate> encodings;   // there is one form
};

// A result with its pictures.
struct PublishedPictures {
    FrameResultPtr result;
    std::int64_t capture_time_utc_ns = 0, published_utc_ns = 0;
    std::chrono::steady_clock::time_point published_at;
    PublishedHeader header() const {
        return {result->sequence,
                capture_time_utc_ns,
                result->times,
                result->subject,
                result->frame_set.recorded_frame,
                published_utc_ns,
                published_at};
    }
    Encodings<PreviewForm> encodings;
};

struct PublishedEvent {
    std::uint64_t number = 0;  // counts from 1
    std::int64_t time_utc_ns = 0;
    std::uint32_t subject_id = 0;
    Event event;
};

using VolumeMailbox = Mailbox<std::shared_ptr<const PublishedVolume>>;
using PoseMailbox = Mailbox<std::shared_ptr<const PublishedPose>>;
using PictureMailbox = Mailbox<std::shared_ptr<const PublishedPictures>>;
using EventMailbox = Mailbox<PublishedEvent>;

// A subscription lasts as long as the caller keeps the mailbox. publish() by one thread at a time, the
// others by any. No method of the hub may be called from on_ready.
class StreamHub {
  public:
    std::shared_ptr<VolumeMailbox> subscribe_volumes(const MailboxOptions& options,
                                                     std::function<void()> on_ready);
    std::shared_ptr<PoseMailbox> subscribe_poses(const MailboxOptions& options,
                                                 std::function<void()> on_ready);
    std::shared_ptr<PictureMailbox> subscribe_pictures(std::function<void()> on_ready);  // the newest only
    // Starts with the newest `past` events.
    std::shared_ptr<EventMailbox> subscribe_events(std::size_t past, std::function<void()> on_ready);

    // To everyone, and the result's events too. `utc_minus_capture_ns` makes UTC of its capture times. Costs
    // the caller a few microseconds a subscriber.
    void publish(const FrameResultPtr& result, std::int64_t utc_minus_capture_ns);
    void publish_event(Event event, std::int64_t time_utc_ns, std::uint32_t subject_id = 0);

    // The newest result, null before the first.
    std::shared_ptr<const PublishedPictures> newest() const;

    // Closes every mailbox, and whichever is subscribed to later. `why` is what the streams end with.
    void close(const absl::Status& why);

    struct Subscribers {
        int volumes = 0, poses = 0, pictures = 0, events = 0;
    };
    Subscribers subscribers() const;

    static constexpr std::size_t kPastEvents = 100;
    static constexpr std::size_t kQueuedEvents = 256;

  private:
    template <typename Box>
    std::shared_ptr<Box> subscribe(std::vector<std::weak_ptr<Box>>& boxes, const MailboxOptions& options,
                                   std::function<void()> on_ready);

    mutable std::mutex mutex_;
    std::vector<std::weak_ptr<VolumeMailbox>> volumes_;
    std::vector<std::weak_ptr<PoseMailbox>> poses_;
    std::vector<std::weak_ptr<PictureMailbox>> pictures_;
    std::vector<std::weak_ptr<EventMailbox>> events_;
    std::shared_ptr<const PublishedPictures> newest_;
    std::deque<PublishedEvent> past_events_;
    std::uint64_t event_count_ = 0;
    absl::Status closed_;
};

}  // namespace kinevox
