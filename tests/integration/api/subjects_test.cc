// CaptureService.ListSubjects, SelectSubjects and NameSubject over an in-process channel.
#include <future>

#include "tests/integration/api/api_fixture.h"
#include "tests/support/patience.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class SubjectsApiTest : public ApiTest {
  protected:
    SubjectsApiTest() {
        pipeline_.control = std::make_shared<SubjectControl>(2);
        std::vector<KnownSubject> known;
        known.push_back({.id = 1,
                         .present = true,
                         .followed = Followed::kYes,
                         .centre_in_world = {1, 2, 0.9},
                         .height_m = 1.8});
        known.push_back({.id = 3, .present = true, .followed = Followed::kOutside});
        known.push_back({.id = 4, .absent_s = 12.5});
        pipeline_.control->publish(known);
    }
    SubjectControl& control() { return *pipeline_.control; }

    static v1::SelectSubjectsRequest follow(const std::vector<std::uint32_t>& ids) {
        v1::SelectSubjectsRequest request;
        request.mutable_followed_ids()->Assign(ids.begin(), ids.end());
        return request;
    }
};

TEST_F(ApiTest, SubjectsNeedPipeline) {
    const auto listed = client_.list_subjects();
    EXPECT_EQ(listed.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(listed.status().message()), HasSubstr("no pipeline"));
    v1::SelectSubjectsRequest all;
    all.set_follow_all(true);
    EXPECT_EQ(client_.select_subjects("ann", all).code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_EQ(client_.name_subject("ann", {}).code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(ApiTest, StreamsCarryEverySubjectWithName) {
    using Named = std::vector<std::pair<std::uint32_t, std::string>>;
    const Named people{{1, "Anna"}, {2, ""}, {5, "Jörg"}, {6, "Anna"}};
    for (const std::size_t count : {0, 1, 2, 4}) {
        auto result = std::make_shared<FrameResult>(*testing::fake_result(7, nullptr));
        const SubjectResult subject = testing::fake_result(7, volume_)->subjects.front();
        const Named expected(people.begin(), people.begin() + static_cast<std::ptrdiff_t>(count));
        for (const auto& [id, name] : expected) {
            SubjectResult& own = result->subjects.emplace_back(subject);
            own.track.subject_id = id;
            own.track.name = name;
        }
        Named posed, shown;
        auto poses = std::async(std::launch::async, [&] {
            const auto take = [&](const v1::StreamPosesResponse& message) {
                for (const v1::SubjectPose& one : message.subjects()) {
                    EXPECT_TRUE(one.has_pose());
                    posed.emplace_back(one.subject_id(), one.name());
                }
                return false;
            };
            return client_.stream_poses({}, take, {});
        });
        auto volumes = std::async(std::launch::async, [&] {
            const auto take = [&](const client::VolumeFrame& frame) {
                for (const client::SubjectVolume& one : frame.subjects) {
                    EXPECT_TRUE(one.volume);
                    shown.emplace_back(one.subject.subject_id(), one.subject.name());
                }
                return false;
            };
            return client_.stream_volumes({}, take, {});
        });
        EXPECT_TRUE(testing::eventually(
            [&] { return hub_.subscribers().poses != 0 && hub_.subscribers().volumes != 0; }));
        hub_.publish(result, 0);
        EXPECT_TRUE(poses.get().ok());
        EXPECT_TRUE(volumes.get().ok());
        EXPECT_EQ(posed, expected);
        EXPECT_EQ(shown, expected);
        EXPECT_TRUE(testing::eventually(
            [&] { return hub_.subscribers().poses == 0 && hub_.subscribers().volumes == 0; }));
    }
}

TEST_F(SubjectsApiTest, ListsEverybodyWithState) {
    v1::NameSubjectRequest name;
    name.set_subject_id(4);
    name.set_name("Anna");
    ASSERT_TRUE(client_.name_subject("ann", name).ok());
    const auto listed = client_.list_subjects();
    ASSERT_TRUE(listed.ok()) << listed.status();
    ASSERT_EQ(listed->subjects_size(), 3);
    EXPECT_EQ(listed->subjects(0).following(), v1::SUBJECT_FOLLOWING_FOLLOWED);
    EXPECT_EQ(listed->subjects(0).centre_in_world().y(), 2);
    EXPECT_EQ(listed->subjects(0).height_m(), 1.8);
    EXPECT_FALSE(listed->subjects(0).has_absent_duration());
    EXPECT_EQ(listed->subjects(1).following(), v1::SUBJECT_FOLLOWING_OUTSIDE);
    EXPECT_EQ(listed->subjects(2).following(), v1::SUBJECT_FOLLOWING_ABSENT);
    EXPECT_EQ(listed->subjects(2).name(), "Anna");
    EXPECT_EQ(listed->subjects(2).absent_duration().seconds(), 12);
}

TEST_F(SubjectsApiTest, SelectsUnderControlOnly) {
    ASSERT_TRUE(client_.select_subjects("ann", follow({3})).ok());
    EXPECT_THAT(control().requests().only, ElementsAre(3));
    const absl::Status unknown = client_.select_subjects("ann", follow({2}));
    EXPECT_EQ(unknown.code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(unknown.message()), HasSubstr("1, 3, 4"));
    EXPECT_EQ(client_.select_subjects("ann", follow({1, 3, 4})).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(client_.select_subjects("ann", {}).code(), absl::StatusCode::kInvalidArgument);
    v1::SelectSubjectsRequest both = follow({1});
    both.set_follow_all(true);
    EXPECT_EQ(client_.select_subjects("ann", both).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(control().requests().only, ElementsAre(3)) << "errors change nothing";

    const std::string held = acquire("bea");
    EXPECT_EQ(client_.select_subjects("ann", follow({1})).code(), absl::StatusCode::kFailedPrecondition);
    ASSERT_TRUE(client_.release_control(held).ok());

    v1::SelectSubjectsRequest ignore;
    ignore.add_ignored_ids(1);
    EXPECT_TRUE(client_.select_subjects("ann", ignore).ok());
    EXPECT_THAT(control().requests().ignored, ElementsAre(1));
    v1::SelectSubjectsRequest all;
    all.set_follow_all(true);
    EXPECT_TRUE(client_.select_subjects("ann", all).ok());
    EXPECT_THAT(control().requests().only, IsEmpty());
    EXPECT_THAT(control().requests().ignored, IsEmpty());
}

}  // namespace
}  // namespace kinevox
