// Publishes each result to its subscribers; the pipeline never waits for them.
#pragma once

#include <absl/status/status.h>

#include <chrono>
#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/body_pose.h"
#include "common/volume.h"
#include "server/events/event_log.h"
#include "server/events/mailbox.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

// The form in which a subscriber requests the volume.
struct VolumeForm {
    int level = 0;  // halvings of the resolution
    bool with_colours = true;
    auto operator<=>(const VolumeForm&) const = default;
};

// The form in which a subscriber requests a preview.
struct PreviewForm {
    std::size_t camera = 0;  // its index in the frame set
    bool silhouette = false;
    int max_width_px = 320;
    int max_height_px = 0;  // 0: no limit
    int jpeg_quality = 80;
    auto operator<=>(const PreviewForm&) const = default;
};

// The header of every published message.
struct PublishedHeader {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_utc_ns = 0;
    StageTimes times;
    std::optional<std::int64_t> recorded_frame;  // of a replay
    std::int64_t published_utc_ns = 0;
    std::chrono::steady_clock::time_point
        published_at;  // the same time; not affected by steps of the system clock
};

// Computes a value per key once for any number of threads, and shares it. get() by any thread. A second
// caller for the same key waits for the first; callers for other keys do not.
template <typename Key, typename Value>
class OnceMap {
  public:
    template <typename Make>
    std::shared_ptr<const Value> get(const Key& key, const Make& make) const {
        std::shared_ptr<Slot> slot;
        {
            const std::scoped_lock lock(mutex_);
            std::shared_ptr<Slot>& entry = slots_[key];
            if (!entry) entry = std::make_shared<Slot>();
            slot = entry;
        }
        std::call_once(slot->once, [&] { slot->value = std::make_shared<const Value>(make()); });
        return slot->value;
    }

  private:
    struct Slot {
        std::once_flag once;
        std::shared_ptr<const Value> value;
    };
    mutable std::mutex mutex_;
    mutable std::map<Key, std::shared_ptr<Slot>> slots_;
};

// A message's bytes as they are sent, the same for all subscribers of one form. Encoded on demand by the
// first that needs them, never on the pipeline's thread.
template <typename Form>
using Encodings = OnceMap<Form, std::string>;

// A result without its images, so that a queue may hold many.
struct PublishedVolume {
    struct Subject {
        SubjectTrack track;
        std::shared_ptr<const Volume> volume;  // null if the frame set does not show the subject
        double litres = 0;
    };
    PublishedHeader header;
    std::vector<Subject> subjects;
    Encodings<VolumeForm> encodings;
};

// A result's poses only: small, so that a queue may hold very many.
struct PublishedPose {
    struct Subject {
        std::uint32_t subject_id = 0;
        std::shared_ptr<const BodyPose> pose;  // null if there is none
        std::string name;                      // empty: none
    };
    PublishedHeader header;
    std::vector<Subject> subjects;
    Encodings<std::monostate> encodings;  // of the only form
};

// A result with its images.
struct PublishedImages {
    FrameResultPtr result;
    std::int64_t capture_time_utc_ns = 0, published_utc_ns = 0;
    std::chrono::steady_clock::time_point published_at;
    PublishedHeader header() const {
        return {result->sequence, capture_time_utc_ns, result->times, result->frame_set.recorded_frame,
                published_utc_ns, published_at};
    }
    Encodings<PreviewForm> encodings;
};

using VolumeMailbox = Mailbox<std::shared_ptr<const PublishedVolume>>;
using PoseMailbox = Mailbox<std::shared_ptr<const PublishedPose>>;
using ImageMailbox = Mailbox<std::shared_ptr<const PublishedImages>>;

// A subscription lasts as long as the caller keeps the mailbox. publish() by one thread at a time, the others
// by any. No method of the hub may be called from on_ready.
class StreamHub {
  public:
    std::shared_ptr<VolumeMailbox> subscribe_volumes(const MailboxOptions& options,
                                                     std::function<void()> on_ready);
    std::shared_ptr<PoseMailbox> subscribe_poses(const MailboxOptions& options,
                                                 std::function<void()> on_ready);
    std::shared_ptr<ImageMailbox> subscribe_images(std::function<void()> on_ready);  // the latest only

    // To all subscribers, with the result's events. `utc_minus_capture_ns` converts its capture times to UTC.
    // Takes a few microseconds per subscriber.
    void publish(const FrameResultPtr& result, std::int64_t utc_minus_capture_ns);
    // Events of the results and of all other parts.
    EventLog& events() { return events_; }

    // The latest result, null before the first.
    std::shared_ptr<const PublishedImages> latest() const;

    // Closes every mailbox, and those subscribed later. `why` is the status the streams end with.
    void close(const absl::Status& why);

    struct Subscribers {
        int volumes = 0, poses = 0, images = 0, events = 0;
        int total() const { return volumes + poses + images + events; }
    };
    Subscribers subscribers() const;

  private:
    template <typename Box>
    std::shared_ptr<Box> subscribe(std::vector<std::weak_ptr<Box>>& boxes, const MailboxOptions& options,
                                   std::function<void()> on_ready);

    mutable std::mutex mutex_;
    std::vector<std::weak_ptr<VolumeMailbox>> volumes_;
    std::vector<std::weak_ptr<PoseMailbox>> poses_;
    std::vector<std::weak_ptr<ImageMailbox>> images_;
    std::shared_ptr<const PublishedImages> latest_;
    absl::Status closed_;
    EventLog events_;
};

}  // namespace kinevox
