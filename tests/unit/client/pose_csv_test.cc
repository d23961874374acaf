#include "client/lib/pose_csv.h"

#include <gmock/gmock.h>

#include <algorithm>

namespace kinevox::client {
namespace {

using ::testing::StartsWith;

std::ptrdiff_t cells(const std::string& line) {
    return std::ranges::count(line, ',') + 1;
}

TEST(PoseCsv, FrameIsRecordedFrameInReplayElseSequence) {
    v1::StreamPosesResponse message;
    message.mutable_header()->set_sequence(812);
    message.mutable_header()->set_capture_time_ns(2'500'000'000);
    message.add_subjects()->set_subject_id(3);
    EXPECT_THAT(pose_csv_lines(PoseColumns::kAngles, message, 2'000'000'000),
                ::testing::ElementsAre(StartsWith("812,0.500000,3,812,")));
    message.mutable_header()->set_recorded_frame(17);
    EXPECT_THAT(pose_csv_lines(PoseColumns::kAngles, message, 2'000'000'000),
                ::testing::ElementsAre(StartsWith("17,0.500000,3,812,")));
}

TEST(PoseCsv, HasOneLinePerSubjectAndOneWithoutSubject) {
    for (const PoseColumns columns :
         {PoseColumns::kAngles, PoseColumns::kJoints, PoseColumns::kCoordinates}) {
        const std::string header = pose_csv_header(columns);
        EXPECT_THAT(header, StartsWith("frame,time_s,subject,sequence,"));
        v1::StreamPosesResponse message;
        const auto none = pose_csv_lines(columns, message, 0);
        ASSERT_EQ(none.size(), 1U);
        EXPECT_THAT(none[0], StartsWith("0,0.000000,,0,"));
        EXPECT_EQ(cells(none[0]), cells(header));
        message.add_subjects()->set_subject_id(1);
        message.add_subjects()->set_subject_id(2);
        const auto two = pose_csv_lines(columns, message, 0);
        ASSERT_EQ(two.size(), 2U);
        EXPECT_THAT(two[1], StartsWith("0,0.000000,2,0,"));
    }
}

TEST(PoseCsv, CoordinatesAreTranslationsThenRotations) {
    v1::StreamPosesResponse message;
    v1::Pose& pose = *message.add_subjects()->mutable_pose();
    for (int i = 0; i < 3; ++i) pose.add_translations()->set_value_m(0.25 * i);
    pose.add_coordinates()->set_value_deg(12.5);
    EXPECT_THAT(
        pose_csv_header(PoseColumns::kCoordinates),
        StartsWith("frame,time_s,subject,sequence,pelvis_x_m,pelvis_y_m,pelvis_z_m,pelvic_tilt_deg,"));
    EXPECT_THAT(pose_csv_lines(PoseColumns::kCoordinates, message, 0)[0],
                StartsWith("0,0.000000,0,0,0.00000,0.25000,0.50000,12.5000,,"));
}

}  // namespace
}  // namespace kinevox::client
