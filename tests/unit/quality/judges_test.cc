// Each judge on synthetic measurements: recognises its cause, and nothing in a good session.
#include "server/quality/judges.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/quality/verdict.h"

namespace kinevox::quality {
namespace {

// As measured on a good session with four cameras.
Measurements good_session() {
    Measurements seen;
    seen.frame_sets = 37;
    for (const char* name : {"cam1", "cam2", "cam3", "cam4"}) {
        CameraMeasurements& camera = seen.cameras.emplace_back();
        camera.name = name;
        camera.mean_level = 108;
        camera.foreground_fraction = 0.03;
        camera.ghost_contour_fraction = 0.01;
        camera.hull_iou = 0.99;
        camera.posed_iou = 0.92;
    }
    seen.rig.hull_iou = seen.rig.min_hull_iou = 0.99;
    seen.rig.low_hull_iou = 0.97;
    seen.rig.residual_px = 0.2;
    seen.world.tilt_deg = 1.0;
    seen.world.lowest_m = -0.02;
    seen.world.subject_height_m = 1.8;
    seen.body.stature_m = 1.8;
    seen.pose.subject_fraction = seen.pose.posed_fraction = 1;
    seen.pose.joint_std_m = 0.014;
    seen.pose.contour_residual_m = 0.009;
    seen.pose.posed_iou = 0.92;
    return seen;
}

// The rig of a session whose silhouettes and cameras contradict each other.
Measurements inconsistent_rig() {
    Measurements seen = good_session();
    seen.rig.hull_iou = seen.rig.min_hull_iou = 0.5;
    seen.rig.residual_px = 12;
    seen.rig.moved = RigHypothesis{.camera = 1, .residual_px = 11, .rotated_deg = 1, .moved_m = 0.05};
    seen.rig.swapped = RigHypothesis{.camera = 0, .residual_px = 20, .other = 2};
    seen.rig.intrinsics = RigHypothesis{.camera = 2, .residual_px = 11, .focal_factor = 0.87};
    seen.rig.all_intrinsics = RigHypothesis{.residual_px = 13, .focal_factor = 1.07};
    return seen;
}

std::string cause_of(const Judgement& judgement) {
    return judgement ? judgement->cause : "";
}
std::string first_cause(const Measurements& seen) {
    const QualityReport report = judge(seen);
    return report.causes.empty() ? "" : report.causes.front().cause;
}

TEST(Verdict, IsThatOfTheWorstSubject) {
    std::vector<Measurements> two(2, good_session());
    two[0].subject_id = 1, two[1].subject_id = 4;
    two[0].followed_subjects = two[1].followed_subjects = 2;
    two[1].pose.joint_std_m = 0.02;
    QualityReport report = judge_worst(two);
    EXPECT_EQ(report.verdict, Trust::kGood);
    EXPECT_EQ(report.measurements.subject_id, 4u) << "the less certain one";
    EXPECT_NE(quality_json(report).find("\"subject\": 4"), std::string::npos);
    two[0].pose.withheld_fraction = 0.4;
    report = judge_worst(two);
    EXPECT_EQ(report.verdict, Trust::kCaution);
    ASSERT_EQ(report.causes.size(), 1u);
    EXPECT_EQ(report.causes.front().cause, "withheld");
    EXPECT_EQ(report.causes.front().reason, "subject 1: 40 % of the joints are withheld");
    EXPECT_EQ(quality_json(report).find("subject_name"), std::string::npos);
    two[0].subject_name = "Jörg";
    report = judge_worst(two);
    EXPECT_EQ(report.causes.front().reason, "subject 1 (Jörg): 40 % of the joints are withheld");
    EXPECT_NE(quality_json(report).find("\"subject_name\": \"Jörg\""), std::string::npos);
    for (Measurements& each : two) each.cameras[2].mean_level = 7, each.cameras[2].dark_fraction = 0.9;
    EXPECT_EQ(judge_worst(two).causes.front().reason.find("subject"), std::string::npos)
        << "an image is not one subject's";
}

TEST(Verdict, IsGoodWithoutCauseForAGoodSession) {
    const QualityReport report = judge(good_session());
    EXPECT_EQ(report.verdict, Trust::kGood);
    EXPECT_TRUE(report.causes.empty());
    EXPECT_NE(quality_text(report).find("GOOD"), std::string::npos);
}

TEST(Verdict, NamesTheWorstCauseFirst) {
    Measurements seen = good_session();
    seen.world.lowest_m = 0.2;  // CAUTION
    seen.body.stature_m = 2.4;  // DO NOT USE
    const QualityReport report = judge(seen);
    EXPECT_EQ(report.verdict, Trust::kDoNotUse);
    ASSERT_EQ(report.causes.size(), 2u);
    EXPECT_EQ(report.causes.front().cause, "scale");
}

TEST(Verdict, WritesNullForWhatWasNotMeasured) {
    Measurements seen = good_session();
    seen.rig.hull_iou.reset();
    const std::string json = quality_json(judge(seen));
    EXPECT_NE(json.find("\"hull_iou\": null"), std::string::npos);
    EXPECT_NE(json.find("\"verdict\": \"GOOD\""), std::string::npos);
}

TEST(Verdict, HasReasonAndRemedyForEachCause) {
    Measurements seen = inconsistent_rig();
    seen.several_people_fraction = 1;
    seen.pose.posed_iou = 0.3;
    for (const Cause& cause : judge(seen).causes) {
        EXPECT_FALSE(cause.reason.empty()) << cause.cause;
        EXPECT_FALSE(cause.remedy.empty()) << cause.cause;
    }
}

TEST(LightJudge, NamesTheDarkCamera) {
    Measurements seen = good_session();
    seen.cameras[2].mean_level = 8;
    seen.cameras[2].dark_fraction = 0.8;
    const Judgement found = judge_light(seen);
    EXPECT_EQ(cause_of(found), "too_dark");
    EXPECT_EQ(found->camera, "cam3");
}

TEST(LightJudge, AcceptsADarkWallInABrightImage) {
    Measurements seen = good_session();
    seen.cameras[2].dark_fraction = 0.4;
    EXPECT_FALSE(judge_light(seen));
}

TEST(LightJudge, NamesTheSaturatedCamera) {
    Measurements seen = good_session();
    seen.cameras[1].mean_level = 230;
    seen.cameras[1].saturated_fraction = 0.6;
    const Judgement found = judge_light(seen);
    EXPECT_EQ(cause_of(found), "saturated");
    EXPECT_EQ(found->camera, "cam2");
}

TEST(BackgroundJudge, RecognisesContoursOfTheBackground) {
    Measurements seen = good_session();
    seen.cameras[0].ghost_contour_fraction = 0.5;
    EXPECT_EQ(cause_of(judge_background(seen)), "background_occupied");
}

TEST(BackgroundJudge, RecognisesSomeOfThemInMostCameras) {
    Measurements seen = good_session();
    seen.cameras[0].ghost_contour_fraction = seen.cameras[1].ghost_contour_fraction = 0.16;
    EXPECT_FALSE(judge_background(seen));
    seen.cameras[2].ghost_contour_fraction = 0.16;
    EXPECT_EQ(cause_of(judge_background(seen)), "background_occupied");
}

TEST(BackgroundJudge, RecognisesAnObjectThatIsGone) {
    Measurements seen = good_session();
    seen.cameras[0].still_area_ratio = 0.5;
    seen.cameras[0].still_in_background_fraction = 0.9;
    EXPECT_EQ(cause_of(judge_background(seen)), "background_occupied");
    EXPECT_FALSE(judge_still_object(seen));
}

TEST(StillObjectJudge, NeedsTwoCameras) {
    Measurements seen = good_session();
    seen.cameras[0].still_area_ratio = 0.5;
    EXPECT_FALSE(judge_still_object(seen));
    seen.cameras[3].still_area_ratio = 0.7;
    const Judgement found = judge_still_object(seen);
    EXPECT_EQ(cause_of(found), "still_object");
    EXPECT_EQ(found->camera, "cam4");
    EXPECT_FALSE(judge_background(seen));
}

TEST(PeopleJudge, IgnoresAShortVisit) {
    Measurements seen = good_session();
    seen.several_people_fraction = 0.1;
    EXPECT_FALSE(judge_people(seen));
    seen.several_people_fraction = 0.8;
    EXPECT_EQ(cause_of(judge_people(seen)), "several_people");
}

TEST(PeopleJudge, DistrustsOnlyPeopleWhoAreNotSeparated) {
    Measurements seen = good_session();
    seen.several_people_fraction = 0.8;
    EXPECT_EQ(judge_people(seen)->trust, Trust::kCaution);
    seen.merged_people_fraction = 0.5;
    EXPECT_EQ(judge_people(seen)->trust, Trust::kDoNotUse);
}

TEST(RigJudges, AskNothingWhileSilhouettesAreConsistent) {
    Measurements seen = good_session();
    seen.rig.moved = RigHypothesis{.camera = 1, .residual_px = 0.01};
    seen.rig.time = RigHypothesis{.camera = 1, .shift_frames = 5};
    EXPECT_FALSE(judge_camera(seen));
    EXPECT_FALSE(judge_time(seen));
    EXPECT_FALSE(judge_intrinsics(seen));
}

TEST(RigJudges, NameTheMovedCamera) {
    Measurements seen = inconsistent_rig();
    seen.rig.moved->residual_px = 1;
    EXPECT_FALSE(judge_intrinsics(seen));
    const Judgement found = judge_camera(seen);
    EXPECT_EQ(cause_of(found), "camera_moved");
    EXPECT_EQ(found->camera, "cam2");
    EXPECT_EQ(first_cause(seen), "camera_moved");
}

TEST(RigJudges, NameSwappedCameras) {
    Measurements seen = inconsistent_rig();
    seen.rig.swapped->residual_px = 0.3;
    EXPECT_EQ(cause_of(judge_camera(seen)), "cameras_swapped");
}

TEST(RigJudges, NameTheLensThatChanged) {
    Measurements seen = inconsistent_rig();
    seen.rig.intrinsics->residual_px = 1;
    const Judgement found = judge_intrinsics(seen);
    EXPECT_EQ(cause_of(found), "intrinsics");
    EXPECT_EQ(found->camera, "cam3");
}

TEST(RigJudges, NameAnotherResolutionOfAllCameras) {
    Measurements seen = inconsistent_rig();
    seen.rig.all_intrinsics->residual_px = 0.5;
    seen.rig.all_intrinsics->focal_factor = 0.667;
    const Judgement found = judge_intrinsics(seen);
    EXPECT_EQ(cause_of(found), "intrinsics");
    EXPECT_EQ(found->camera, "");
}

TEST(RigJudges, NameTheCameraOfAnotherTimeBeforeAMove) {
    Measurements seen = inconsistent_rig();
    seen.rig.time = RigHypothesis{.camera = 3, .shift_frames = 8};
    seen.rig.moved->residual_px = 5;  // a move explains a part of it
    EXPECT_EQ(first_cause(seen), "camera_time");
    seen.rig.moved->residual_px = 1;  // all of it: the shift is a consequence
    EXPECT_EQ(first_cause(seen), "camera_moved");
    seen.rig.moved->residual_px = 5;
    seen.rig.time->shift_frames = 0.2;
    EXPECT_FALSE(judge_time(seen));
}

TEST(RigJudges, NameTheCameraOfAnotherTimeWhereOnlyMovementShowsIt) {
    Measurements seen = good_session();
    seen.rig.time = RigHypothesis{.camera = 2, .shift_frames = -8};
    EXPECT_FALSE(time_is_doubtful(seen.rig));
    seen.rig.low_hull_iou = 0.95;
    EXPECT_TRUE(time_is_doubtful(seen.rig));
    EXPECT_EQ(judge_time(seen)->camera, "cam3");
    EXPECT_EQ(first_cause(seen), "camera_time");
    seen.rig.time->shift_frames = 1;  // contradictions of few frame sets have other causes, too
    EXPECT_FALSE(judge_time(seen));
}

TEST(WorldJudge, RecognisesUpsideDownTiltAndFloor) {
    Measurements seen = good_session();
    seen.world.lowest_m = 0.3;
    EXPECT_EQ(cause_of(judge_world(seen)), "floor_height");
    seen.world.tilt_deg = 12;
    EXPECT_EQ(cause_of(judge_world(seen)), "world_tilted");
    seen.world.tilt_deg = 179;
    EXPECT_EQ(cause_of(judge_world(seen)), "world_upside_down");
    seen = good_session();
    seen.world.tilt_deg.reset();
    seen.world.cameras_below_fraction = 1;
    EXPECT_EQ(cause_of(judge_world(seen)), "world_upside_down");
}

TEST(WorldJudge, AcceptsACameraBelowTheFloor) {
    Measurements seen = good_session();
    seen.world.cameras_below_fraction = 0.25;
    EXPECT_FALSE(judge_world(seen));
}

TEST(ScaleJudge, RecognisesImpossibleStatures) {
    Measurements seen = good_session();
    for (const double stature_m : {0.6, 1.2, 2.3}) {
        seen.body.stature_m = stature_m;
        EXPECT_EQ(cause_of(judge_scale(seen)), "scale") << stature_m;
    }
    for (const double stature_m : {1.45, 1.75, 2.05}) {
        seen.body.stature_m = stature_m;
        EXPECT_FALSE(judge_scale(seen)) << stature_m;
    }
    seen.body.stature_m = 2.06;  // drawn towards the mean
    seen.world.subject_height_m = 2.34;
    EXPECT_EQ(cause_of(judge_scale(seen)), "scale");
    seen.body.stature_m = 1.8;  // arms overhead
    EXPECT_FALSE(judge_scale(seen));
    seen.body.stature_m = 1.65;
    seen.world.max_height_m = 1.27;  // crouches
    seen.world.volume_litres = 70;
    seen.pose.posed_iou = 0.64;
    EXPECT_FALSE(judge_scale(seen));
    seen.world.volume_litres = 37;
    EXPECT_EQ(cause_of(judge_scale(seen)), "scale");
    seen.body.stature_m = 1.47;
    seen.world.max_height_m = 0.75;  // sits on the floor
    EXPECT_FALSE(judge_scale(seen)) << "a small person has a small volume";
}

TEST(ScaleJudge, RecognisesALargeHullThatNoBodyFits) {
    Measurements seen = good_session();
    seen.body.stature_m = 1.93;
    seen.world.subject_height_m = 2.3;
    seen.world.volume_litres = 190;
    seen.pose.posed_iou = 0.82;
    EXPECT_EQ(cause_of(judge_scale(seen)), "scale");
    seen.pose.posed_iou = 0.92;  // raised arms
    EXPECT_FALSE(judge_scale(seen));
    seen.pose.posed_iou = 0.82;
    seen.world.volume_litres = 125;
    EXPECT_FALSE(judge_scale(seen));
}

TEST(BodyJudge, ComparesOnlyAGivenBody) {
    Measurements seen = good_session();
    seen.body.stature_m = 1.65;
    seen.body.fitted_stature_m = 1.8;
    EXPECT_FALSE(judge_body(seen));
    seen.body.given = true;
    EXPECT_EQ(cause_of(judge_body(seen)), "wrong_body");
    seen.body.stature_m = 1.78;
    EXPECT_FALSE(judge_body(seen));
}

TEST(ViewJudge, NeedsHalfOfTheCameras) {
    Measurements seen = good_session();
    seen.cameras[0].truncated_fraction = 0.9;
    EXPECT_FALSE(judge_view(seen));
    seen.cameras[1].seen_fraction = 0.2;
    EXPECT_EQ(cause_of(judge_view(seen)), "out_of_view");
}

TEST(ViewJudge, ReportsASessionWithoutSubject) {
    Measurements seen = good_session();
    seen.pose.subject_fraction = 0;
    EXPECT_EQ(cause_of(judge_view(seen)), "no_subject");
}

TEST(SilhouetteJudge, TrustsLessTheWorseThePosedBodyFits) {
    Measurements seen = good_session();
    seen.pose.posed_iou = 0.7;
    ASSERT_TRUE(judge_silhouettes(seen));
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kCaution);
    seen.pose.posed_iou = 0.4;
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kCaution) << "the joints are determined all the same";
    seen.pose.joint_std_m = 0.04;
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kDoNotUse);
}

TEST(SilhouetteJudge, NamesFeetThatAreMissing) {
    Measurements seen = good_session();
    seen.body.feet_unseen = true;
    ASSERT_TRUE(judge_silhouettes(seen));
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kCaution);
    EXPECT_THAT(judge_silhouettes(seen)->reason, ::testing::HasSubstr("feet"));
}

TEST(SilhouetteJudge, NamesLegsThatAreMissing) {
    Measurements seen = good_session();
    seen.body.stature_m = 1.86;
    seen.world.lowest_m = 1.03;
    seen.world.subject_height_m = 1.26;
    seen.world.max_height_m = 1.3;
    seen.world.volume_litres = 30;
    seen.pose.posed_iou = 0.7;
    ASSERT_TRUE(judge_silhouettes(seen));
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kCaution) << "other cameras see the legs";
    seen.pose.withheld_fraction = 0.4;
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kDoNotUse);
    EXPECT_THAT(judge_silhouettes(seen)->reason, ::testing::HasSubstr("1.03 m above the floor"));
    EXPECT_FALSE(judge_world(seen)) << "the floor is not the cause";
    EXPECT_FALSE(judge_scale(seen)) << "the scale is not the cause";
    seen.world.subject_height_m = 1.7;  // complete, on a beam
    EXPECT_EQ(cause_of(judge_world(seen)), "floor_height");
    seen.pose.lowest_m = 0.01;  // the hull lacks the shoes
    EXPECT_FALSE(judge_world(seen));
    EXPECT_EQ(judge_silhouettes(seen)->trust, Trust::kCaution);
}

}  // namespace
}  // namespace kinevox::quality
