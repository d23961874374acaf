#include "server/events/event.h"

#include <absl/strings/ascii.h>
#include <gtest/gtest.h>

#include <set>

#include "kinevox/v1/capture_service.pb.h"
#include "server/events/event_log.h"

namespace kinevox {
namespace {

TEST(EventKinds, HaveTheNamesOfTheApi) {
    std::set<v1::EventKind> seen;
    for (const EventKindInfo& info : kEventKinds) {
        v1::EventKind kind{};
        ASSERT_TRUE(v1::EventKind_Parse("EVENT_KIND_" + absl::AsciiStrToUpper(std::string(info.name)), &kind))
            << info.name;
        seen.insert(kind);
    }
    EXPECT_EQ(static_cast<int>(seen.size()), v1::EventKind_descriptor()->value_count() - 1)
        << "all but UNSPECIFIED";
}

TEST(EventLog, StartsWithHistory) {
    EventLog log;
    log.publish(EventKind::kCaptureStarted, "a");
    log.publish(EventKind::kCaptureStopped, "b", 7);
    const auto box = log.subscribe(1, [] {});
    EXPECT_EQ(log.subscriber_count(), 1);
    const auto taken = box->take();
    ASSERT_TRUE(taken);
    EXPECT_EQ(taken->message.id, 2u);
    EXPECT_EQ(taken->message.event.message, "b");
    EXPECT_EQ(taken->message.event.sequence, 7u);
    EXPECT_FALSE(box->take());
}

}  // namespace
}  // namespace kinevox
