// Parsing of subscriptions, and the outbox of one browser.
#include <gmock/gmock.h>

#include <limits>
#include <random>

#include "client/web/subscriptions.h"

namespace kinevox::web {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

v1::StreamSubscription subscription(v1::StreamKind kind, int downsample_level = 0,
                                    const std::string& camera = "", double rate_hz = 0) {
    v1::StreamSubscription out;
    out.set_kind(kind);
    out.set_downsample_level(downsample_level);
    out.set_camera(camera);
    out.set_max_rate_hz(rate_hz);
    return out;
}

SubscriptionRequest parsed(const std::vector<v1::StreamSubscription>& subscriptions) {
    v1::BrowserMessage message;
    for (const v1::StreamSubscription& s : subscriptions) *message.add_subscriptions() = s;
    return parse_subscriptions(message.SerializeAsString());
}

TEST(ParseSubscriptions, AcceptsPosesVolumesStatusAndSilhouettes) {
    const SubscriptionRequest request =
        parsed({subscription(v1::STREAM_KIND_POSES), subscription(v1::STREAM_KIND_VOLUMES, 2, "", 25),
                subscription(v1::STREAM_KIND_STATUS), subscription(v1::STREAM_KIND_SILHOUETTE, 0, "cam1"),
                subscription(v1::STREAM_KIND_POSES)});
    EXPECT_THAT(request.errors, IsEmpty());
    ASSERT_THAT(request.accepted, SizeIs(4)) << "duplicates are dropped";
    EXPECT_EQ(request.accepted[1].topic, (Topic{Topic::Kind::kVolumes, 2, {}}));
    EXPECT_EQ(request.accepted[1].max_rate_hz, 25);
    EXPECT_EQ(request.accepted[3].topic, (Topic{Topic::Kind::kSilhouette, 0, "cam1"}));
}

TEST(ParseSubscriptions, RejectsImagesOnly) {
    const SubscriptionRequest request =
        parsed({subscription(v1::STREAM_KIND_IMAGE, 0, "cam1"), subscription(v1::STREAM_KIND_POSES)});
    ASSERT_THAT(request.errors, SizeIs(1));
    EXPECT_EQ(request.errors[0].code(), "PERMISSION_DENIED");
    EXPECT_EQ(request.errors[0].subscription().camera(), "cam1");
    EXPECT_THAT(request.errors[0].message(), HasSubstr("never"));
    EXPECT_THAT(request.accepted, SizeIs(1));
}

TEST(ParseSubscriptions, RejectsUnknownKinds) {
    for (int kind = -3; kind < 300; ++kind) {
        const SubscriptionRequest request =
            parsed({subscription(static_cast<v1::StreamKind>(kind), 0, "cam1")});
        const bool known = kind >= v1::STREAM_KIND_POSES && kind <= v1::STREAM_KIND_SILHOUETTE;
        EXPECT_EQ(request.accepted.size(), known ? 1 : 0) << kind;
        EXPECT_EQ(request.errors.size(), known ? 0 : 1) << kind;
    }
}

TEST(ParseSubscriptions, NamesValuesOutOfRange) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const auto& [bad, words] :
         {std::pair{subscription(v1::STREAM_KIND_VOLUMES, 6), "downsample_level is 6"},
          std::pair{subscription(v1::STREAM_KIND_VOLUMES, -1), "downsample_level is -1"},
          std::pair{subscription(v1::STREAM_KIND_SILHOUETTE), "camera"},
          std::pair{subscription(v1::STREAM_KIND_POSES, 0, "", -1), "max_rate_hz"},
          std::pair{subscription(v1::STREAM_KIND_POSES, 0, "", 1e-12), "max_rate_hz"},
          std::pair{subscription(v1::STREAM_KIND_POSES, 0, "", nan), "max_rate_hz"},
          std::pair{subscription(v1::STREAM_KIND_SILHOUETTE, 0, std::string(101, 'a')), "camera"}}) {
        const SubscriptionRequest request = parsed({bad});
        ASSERT_THAT(request.errors, SizeIs(1)) << words;
        EXPECT_EQ(request.errors[0].code(), "INVALID_ARGUMENT");
        EXPECT_THAT(request.errors[0].message(), HasSubstr(words));
        EXPECT_THAT(request.accepted, IsEmpty());
    }
}

TEST(ParseSubscriptions, RejectsInvalidMessages) {
    const std::string unknown_field =
        "\x7a\x03"
        "abc";  // field 15 of the message
    const std::string unknown_in_subscription =
        std::string("\x0a\x04\x08\x01\x78\x01", 6);  // field 15 of a subscription
    const std::vector<v1::StreamSubscription> many(17, subscription(v1::STREAM_KIND_POSES));
    EXPECT_FALSE(parsed(many).valid);
    for (const std::string& bytes :
         {std::string("\xff\xff\xff"), std::string("GET / HTTP/1.1"), unknown_field, unknown_in_subscription,
          std::string(kMaxBrowserMessage_bytes + 1, '\0')}) {
        const SubscriptionRequest request = parse_subscriptions(bytes);
        EXPECT_FALSE(request.valid);
        EXPECT_THAT(request.accepted, IsEmpty());
        ASSERT_THAT(request.errors, SizeIs(1));
        EXPECT_EQ(request.errors[0].code(), "INVALID_ARGUMENT");
    }
    EXPECT_TRUE(parse_subscriptions("").valid) << "no subscriptions";
}

TEST(ParseSubscriptions, AcceptsOnlyKnownTopicsFromRandomBytes) {
    std::mt19937 random(1);
    for (int n = 0; n < 20'000; ++n) {
        std::string bytes(random() % 40, '\0');
        for (char& c : bytes) c = static_cast<char>(random());
        if (n % 2 && bytes.size() > 2)
            bytes[0] = 0x0a, bytes[1] = static_cast<char>(bytes.size() - 2);  // a subscription
        for (const Subscription& s : parse_subscriptions(bytes).accepted) {
            EXPECT_LE(s.topic.kind, Topic::Kind::kSilhouette);
            EXPECT_TRUE(s.topic.downsample_level >= 0 && s.topic.downsample_level <= 5);
        }
    }
}

std::shared_ptr<const std::string> body(const std::string& text) {
    return std::make_shared<const std::string>(text);
}

std::uint64_t missed_count(const Outgoing& out) {
    v1::GatewayMessage head;
    EXPECT_TRUE(head.ParseFromString(out.head));
    return head.missed_count();
}

TEST(Outbox, KeepsLatestAndCountsMissed) {
    const Topic poses{Topic::Kind::kPoses, 0, {}}, volumes{Topic::Kind::kVolumes, 1, {}};
    Outbox outbox;
    outbox.subscribe({{poses}, {volumes}});
    const Clock::time_point now;
    outbox.put(poses, body("p1"), 0, now);
    outbox.put(volumes, body("v1"), 0, now);
    outbox.put(poses, body("p2"), 3, now);
    outbox.put({Topic::Kind::kStatus, 0, {}}, body("not subscribed"), 0, now);
    auto first = outbox.take(), second = outbox.take();
    ASSERT_TRUE(first && second);
    EXPECT_EQ(*first->body, "p2");
    EXPECT_EQ(missed_count(*first), 4) << "one replaced, three dropped before";
    EXPECT_EQ(*second->body, "v1");
    EXPECT_EQ(missed_count(*second), 0);
    EXPECT_FALSE(outbox.take());
    EXPECT_TRUE(outbox.empty());
}

TEST(Outbox, LimitsRate) {
    const Topic poses{Topic::Kind::kPoses, 0, {}};
    Outbox outbox;
    outbox.subscribe({{poses, 10}});
    Clock::time_point now = Clock::now();
    int got = 0;
    std::uint64_t lost = 0;
    for (int n = 0; n < 100; ++n, now += std::chrono::milliseconds(20)) {  // two seconds at 50 Hz
        outbox.put(poses, body("p"), 0, now);
        if (const auto out = outbox.take()) ++got, lost += missed_count(*out);
    }
    EXPECT_GE(got, 19);
    EXPECT_LE(got, 22);
    EXPECT_GE(got + static_cast<int>(lost), 95);
}

TEST(Outbox, SendsRepliesFirstAndBoundsThem) {
    const Topic poses{Topic::Kind::kPoses, 0, {}};
    Outbox outbox;
    outbox.subscribe({{poses}});
    outbox.put(poses, body("p"), 0, Clock::now());
    for (std::size_t n = 0; n < Outbox::kMaxReplies; ++n) EXPECT_TRUE(outbox.reply("no"));
    EXPECT_FALSE(outbox.reply("no")) << "the browser does not read";
    EXPECT_EQ(*outbox.take()->body, "no");
    outbox.subscribe({});
    for (std::size_t n = 1; n < Outbox::kMaxReplies; ++n) EXPECT_EQ(*outbox.take()->body, "no");
    EXPECT_FALSE(outbox.take()) << "messages of ended subscriptions are dropped";
}

}  // namespace
}  // namespace kinevox::web
