#include "server/pipeline/stream_hub.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using testing::fake_result;

std::shared_ptr<const Volume> person() {
    static const auto volume = std::make_shared<const Volume>(testing::person_volume(0.04));
    return volume;
}

std::vector<std::uint64_t> sequences_in(VolumeMailbox& box) {
    std::vector<std::uint64_t> out;
    while (const auto taken = box.take()) out.push_back(taken->message->header.sequence);
    return out;
}

constexpr auto no_reader = [] {};
const MailboxOptions kLossless{MailboxOptions::WhenFull::kOverflow, 4, SIZE_MAX};

TEST(StreamHub, LatestOnlyCountsMissedResults) {
    StreamHub hub;
    const auto box = hub.subscribe_volumes({}, no_reader);
    for (std::uint64_t i = 0; i < 5; ++i) hub.publish(fake_result(i, person()), 0);
    const auto taken = box->take();
    ASSERT_TRUE(taken);
    EXPECT_EQ(taken->message->header.sequence, 4u);
    EXPECT_EQ(taken->missed, 4u);
    EXPECT_FALSE(box->take());
    hub.publish(fake_result(5, person()), 0);
    EXPECT_EQ(box->take()->missed, 0u) << "reported once only";
}

TEST(StreamHub, LosslessMissesNoneWithinBounds) {
    StreamHub hub;
    const auto box = hub.subscribe_volumes(kLossless, no_reader);
    for (std::uint64_t i = 0; i < 4; ++i) hub.publish(fake_result(i, person()), 0);
    EXPECT_THAT(sequences_in(*box), ElementsAre(0, 1, 2, 3));
    for (std::uint64_t i = 4; i < 8; ++i) hub.publish(fake_result(i, person()), 0);
    EXPECT_THAT(sequences_in(*box), ElementsAre(4, 5, 6, 7));
    EXPECT_TRUE(box->status().ok());
}

TEST(StreamHub, ReportsLosslessOverflowAndFreesQueue) {
    StreamHub hub;
    const auto box = hub.subscribe_volumes(kLossless, no_reader);
    const auto volume = std::make_shared<const Volume>(*person());
    for (std::uint64_t i = 0; i < 5; ++i) hub.publish(fake_result(i, volume), 0);
    EXPECT_EQ(box->status().code(), absl::StatusCode::kResourceExhausted);
    EXPECT_EQ(box->queued(), 0u);
    hub.publish(fake_result(5, nullptr), 0);
    EXPECT_EQ(box->queued(), 0u) << "after the end nothing is queued";
    EXPECT_EQ(volume.use_count(), 1) << "ours; the hub keeps the newest result alone";
}

TEST(StreamHub, BoundsLosslessQueueInBytes) {
    StreamHub hub;
    const std::size_t one =
        person()->bricks.size() * sizeof(VolumeBrick) + person()->colours.size() * sizeof(Rgb);
    const auto box = hub.subscribe_volumes({MailboxOptions::WhenFull::kOverflow, 1000, 3 * one}, no_reader);
    hub.publish(fake_result(0, person()), 0);
    hub.publish(fake_result(1, person()), 0);
    EXPECT_TRUE(box->status().ok());
    hub.publish(fake_result(2, person()), 0);
    EXPECT_EQ(box->status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(StreamHub, FreesImagesOfQueuedVolumes) {
    StreamHub hub;
    const auto box = hub.subscribe_volumes(kLossless, no_reader);
    FrameResultPtr result = fake_result(0, person());
    const std::weak_ptr<const FrameResult> images = result;
    hub.publish(result, 0);
    result.reset();
    hub.publish(fake_result(1, person()), 0);  // the hub itself keeps the newest alone
    EXPECT_TRUE(images.expired());
    EXPECT_THAT(sequences_in(*box), ElementsAre(0, 1));
}

TEST(StreamHub, EncodesOncePerForm) {
    StreamHub hub;
    const auto first = hub.subscribe_volumes({}, no_reader), second = hub.subscribe_volumes({}, no_reader);
    hub.publish(fake_result(0, person()), 0);
    const auto a = first->take(), b = second->take();
    int made = 0;
    const auto make = [&] { return ++made, std::string("bytes"); };
    EXPECT_EQ(a->message->encodings.get({0, true}, make), b->message->encodings.get({0, true}, make));
    EXPECT_EQ(made, 1);
    a->message->encodings.get({0, false}, make);
    EXPECT_EQ(made, 2) << "another form is another encoding";
}

TEST(StreamHub, NotifiesOfPublicationsAndClose) {
    StreamHub hub;
    int notified = 0;
    const auto box = hub.subscribe_volumes({}, [&] { ++notified; });
    hub.publish(fake_result(0, person()), 0);
    EXPECT_EQ(notified, 1);
    hub.close(absl::UnavailableError("the daemon is stopping"));
    EXPECT_EQ(notified, 2);
    EXPECT_THAT(sequences_in(*box), ElementsAre(0)) << "what was published before the end is still given out";
    EXPECT_EQ(box->status().code(), absl::StatusCode::kUnavailable);
    const auto late = hub.subscribe_volumes({}, no_reader);
    EXPECT_EQ(late->status().code(), absl::StatusCode::kUnavailable);
}

TEST(StreamHub, PublishesEventsAfterHistory) {
    StreamHub hub;
    for (int i = 0; i < 3; ++i)
        hub.events().publish({EventKind::kCaptureStarted, 0, 0, {}, std::to_string(i)}, 7);
    const auto box = hub.events().subscribe(2, no_reader);
    hub.events().publish({EventKind::kCaptureStopped, 0, 0, {}, "3"}, 8);
    std::vector<std::string> messages;
    std::vector<std::uint64_t> ids;
    while (const auto taken = box->take()) {
        messages.push_back(taken->message.event.message);
        ids.push_back(taken->message.id);
    }
    EXPECT_THAT(messages, ElementsAre("1", "2", "3"));
    EXPECT_THAT(ids, ElementsAre(2, 3, 4));
}

TEST(StreamHub, DropsOldestEventsOfSlowSubscriber) {
    StreamHub hub;
    const auto box = hub.events().subscribe(0, no_reader);
    for (std::size_t i = 0; i < EventLog::kMaxQueued + 10; ++i)
        hub.events().publish({EventKind::kCaptureStarted, 0, 0, {}, {}}, 0);
    const auto taken = box->take();
    EXPECT_EQ(taken->message.id, 11u);
    EXPECT_EQ(taken->missed, 10u);
    EXPECT_EQ(box->take()->missed, 0u);
}

TEST(StreamHub, ForgetsUnsubscribed) {
    StreamHub hub;
    auto box = hub.subscribe_volumes({}, no_reader);
    EXPECT_EQ(hub.subscribers().volumes, 1);
    box.reset();
    EXPECT_EQ(hub.subscribers().volumes, 0);
}

}  // namespace
}  // namespace kinevox
