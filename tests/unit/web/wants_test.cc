// What browsers may ask for and what they are refused; what waits for them.
#include "client/web/wants.h"

#include <gmock/gmock.h>

#include <limits>
#include <random>

#include "client/web/outbox.h"

namespace kinevox::web {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

v1::Want want(v1::Kind kind, int level = 0, const std::string& camera = "", double rate_hz = 0) {
    v1::Want out;
    out.set_kind(kind);
    out.set_level(level);
    out.set_camera(camera);
    out.set_max_rate_hz(rate_hz);
    return out;
}

Wants asked(const std::vector<v1::Want>& wants) {
    v1::BrowserMessage message;
    for (const v1::Want& w : wants) *message.add_wants() = w;
    return read_wants(message.SerializeAsString());
}

TEST(Wants, PosesVolumesStatusAndSilhouettesAreGranted) {
    const Wants wants = asked({want(v1::KIND_POSES), want(v1::KIND_VOLUMES, 2, "", 25), want(v1::KIND_STATUS),
                               want(v1::KIND_SILHOUETTE, 0, "cam1"), want(v1::KIND_POSES)});
    EXPECT_THAT(wants.refused, IsEmpty());
    ASSERT_THAT(wants.granted, SizeIs(4)) << "each once";
    EXPECT_EQ(wants.granted[1].topic, (Topic{Topic::Kind::kVolumes, 2, {}}));
    EXPECT_EQ(wants.granted[1].max_rate_hz, 25);
    EXPECT_EQ(wants.granted[3].topic, (Topic{Topic::Kind::kSilhouette, 0, "cam1"}));
}

TEST(Wants, PicturesAreRefusedAndTheRestIsNot) {
    const Wants wants = asked({want(v1::KIND_PICTURE, 0, "cam1"), want(v1::KIND_POSES)});
    ASSERT_THAT(wants.refused, SizeIs(1));
    EXPECT_EQ(wants.refused[0].code(), "PERMISSION_DENIED");
    EXPECT_EQ(wants.refused[0].want().camera(), "cam1");
    EXPECT_THAT(wants.refused[0].message(), HasSubstr("never"));
    EXPECT_THAT(wants.granted, SizeIs(1));
}

TEST(Wants, EveryNumberOfAKindIsGrantedAsWhatItIsOrRefused) {
    for (int kind = -3; kind < 300; ++kind) {
        const Wants wants = asked({want(static_cast<v1::Kind>(kind), 0, "cam1")});
        const bool known = kind >= v1::KIND_POSES && kind <= v1::KIND_SILHOUETTE;
        EXPECT_EQ(wants.granted.size(), known ? 1 : 0) << kind;
        EXPECT_EQ(wants.refused.size(), known ? 0 : 1) << kind;
    }
}

TEST(Wants, ValuesOutOfRangeAreNamed) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    for (const auto& [bad, words] :
         {std::pair{want(v1::KIND_VOLUMES, 6), "level is 6"},
          std::pair{want(v1::KIND_VOLUMES, -1), "level is -1"},
          std::pair{want(v1::KIND_SILHOUETTE), "camera"},
          std::pair{want(v1::KIND_POSES, 0, "", -1), "max_rate_hz"},
          std::pair{want(v1::KIND_POSES, 0, "", 1e-12), "max_rate_hz"},
          std::pair{want(v1::KIND_POSES, 0, "", nan), "max_rate_hz"},
          std::pair{want(v1::KIND_SILHOUETTE, 0, std::string(101, 'a')), "camera"}}) {
        const Wants wants = asked({bad});
        ASSERT_THAT(wants.refused, SizeIs(1)) << words;
        EXPECT_EQ(wants.refused[0].code(), "INVALID_ARGUMENT");
        EXPECT_THAT(wants.refused[0].message(), HasSubstr(words));
        EXPECT_THAT(wants.granted, IsEmpty());
    }
}

TEST(Wants, BytesThatAreNoMessageChangeNothing) {
    const std::string unknown_field =
        "\x7a\x03"
        "abc";  // field 15 of the message
    const std::string unknown_in_want = std::string("\x0a\x04\x08\x01\x78\x01", 6);  // field 15 of a want
    const std::vector<v1::Want> many(17, want(v1::KIND_POSES));
    EXPECT_FALSE(asked(many).understood);
    for (const std::string& bytes :
         {std::string("\xff\xff\xff"), std::string("GET / HTTP/1.1"), unknown_field, unknown_in_want,
          std::string(kMaxBrowserMessage_bytes + 1, '\0')}) {
        const Wants wants = read_wants(bytes);
        EXPECT_FALSE(wants.understood);
        EXPECT_THAT(wants.granted, IsEmpty());
        ASSERT_THAT(wants.refused, SizeIs(1));
        EXPECT_EQ(wants.refused[0].code(), "INVALID_ARGUMENT");
    }
    EXPECT_TRUE(read_wants("").understood) << "wants nothing";
}

TEST(Wants, RandomBytesNeverYieldAnythingButKnownTopics) {
    std::mt19937 random(1);
    for (int n = 0; n < 20'000; ++n) {
        std::string bytes(random() % 40, '\0');
        for (char& c : bytes) c = static_cast<char>(random());
        if (n % 2 && bytes.size() > 2)
            bytes[0] = 0x0a, bytes[1] = static_cast<char>(bytes.size() - 2);  // a want
        for (const Subscription& s : read_wants(bytes).granted) {
            EXPECT_LE(s.topic.kind, Topic::Kind::kSilhouette);
            EXPECT_TRUE(s.topic.level >= 0 && s.topic.level <= 5);
        }
    }
}

std::shared_ptr<const std::string> body(const std::string& text) {
    return std::make_shared<const std::string>(text);
}

std::uint64_t missed(const Outgoing& out) {
    v1::GatewayMessage head;
    EXPECT_TRUE(head.ParseFromString(out.head));
    return head.missed();
}

TEST(Outbox, KeepsTheNewestAndCountsWhatItReplaced) {
    const Topic poses{Topic::Kind::kPoses, 0, {}}, volumes{Topic::Kind::kVolumes, 1, {}};
    Outbox outbox;
    outbox.subscribe({{poses}, {volumes}});
    const Clock::time_point now;
    outbox.put(poses, body("p1"), 0, now);
    outbox.put(volumes, body("v1"), 0, now);
    outbox.put(poses, body("p2"), 3, now);
    outbox.put({Topic::Kind::kStatus, 0, {}}, body("not asked for"), 0, now);
    auto first = outbox.take(), second = outbox.take();
    ASSERT_TRUE(first && second);
    EXPECT_EQ(*first->body, "p2");
    EXPECT_EQ(missed(*first), 4) << "one replaced, three lost before";
    EXPECT_EQ(*second->body, "v1");
    EXPECT_EQ(missed(*second), 0);
    EXPECT_FALSE(outbox.take());
    EXPECT_TRUE(outbox.empty());
}

TEST(Outbox, LimitsTheRateOfAStream) {
    const Topic poses{Topic::Kind::kPoses, 0, {}};
    Outbox outbox;
    outbox.subscribe({{poses, 10}});
    Clock::time_point now = Clock::now();
    int got = 0;
    std::uint64_t lost = 0;
    for (int n = 0; n < 100; ++n, now += std::chrono::milliseconds(20)) {  // two seconds at 50 Hz
        outbox.put(poses, body("p"), 0, now);
        if (const auto out = outbox.take()) ++got, lost += missed(*out);
    }
    EXPECT_GE(got, 19);
    EXPECT_LE(got, 22);
    EXPECT_GE(got + static_cast<int>(lost), 95);
}

TEST(Outbox, AnswersGoFirstAndAreBounded) {
    const Topic poses{Topic::Kind::kPoses, 0, {}};
    Outbox outbox;
    outbox.subscribe({{poses}});
    outbox.put(poses, body("p"), 0, Clock::now());
    for (std::size_t n = 0; n < Outbox::kMaxAnswers; ++n) EXPECT_TRUE(outbox.answer("no"));
    EXPECT_FALSE(outbox.answer("no")) << "it does not read";
    EXPECT_EQ(*outbox.take()->body, "no");
    outbox.subscribe({});
    for (std::size_t n = 1; n < Outbox::kMaxAnswers; ++n) EXPECT_EQ(*outbox.take()->body, "no");
    EXPECT_FALSE(outbox.take()) << "what is no longer asked for is not sent";
}

}  // namespace
}  // namespace kinevox::web
