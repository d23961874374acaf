// BVH files: what is read, what is refused and how, and that the poses are the ones in the file.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "server/pose/database/bvh_import.h"
#include "tests/support/database_queries.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

struct Names {
    std::string hips, spine, neck, head, thigh, shin, foot, toe, upper_arm, forearm, hand;
    std::function<std::string(const std::string&, bool left)> with_side;
};
const Names kMixamo{
    "mixamorig:Hips",
    "mixamorig:Spine",
    "mixamorig:Neck",
    "mixamorig:Head",
    "UpLeg",
    "Leg",
    "Foot",
    "ToeBase",
    "Arm",
    "ForeArm",
    "Hand",
    [](const std::string& name, bool left) { return (left ? "mixamorig:Left" : "mixamorig:Right") + name; }};
const Names kDotted{
    "root",  "spine 01", "neck",
    "head",  "thigh",    "shin",
    "foot",  "toe",      "shoulder",
    "elbow", "wrist",    [](const std::string& name, bool left) { return name + (left ? ".L" : ".R"); }};

// A body's skeleton and its movement as a BVH file of that naming; y up, centimetres.
// As `kinevox export` writes it: no neck, no toes, a foot's end instead.
const Names kOwn{
    "Hips",    "Spine", "Head",
    "",        "UpLeg", "Leg",
    "Foot",    "",      "Arm",
    "ForeArm", "Hand",  [](const std::string& name, bool left) { return (left ? "Left" : "Right") + name; }};

class BvhFile {
  public:
    BvhFile(const BodyModel& model, const Names& names) : model_(model), names_(names) {}

    std::string text(const std::vector<BodyCoordinates>& poses) {
        text_ = "HIERARCHY\n";
        order_.clear();
        joint("ROOT", names_.hips, kPelvis, {});
        text_ += fmt::format("MOTION\nFrames: {}\nFrame Time: 0.05\n", poses.size());
        for (const BodyCoordinates& pose : poses) {
            const BodyPosture posture = posture_from_coordinates(pose);
            text_ += fmt::format("{} {} {}", 100 * pose[1], 100 * pose[2], 100 * pose[0]);
            for (const int segment : order_) {
                const Mat3 r = to_file(posture.parent_from_segment[segment]);
                const double b = std::asin(std::clamp(r(2, 1), -1.0, 1.0));
                text_ += fmt::format(" {:.6f} {:.6f} {:.6f}", deg(std::atan2(-r(0, 1), r(1, 1))), deg(b),
                                     deg(std::atan2(-r(2, 0), r(2, 2))));
            }
            text_ += "\r\n";
        }
        return text_;
    }

  private:
    static double deg(double radians) { return radians * 180 / std::numbers::pi; }
    static Vec3 to_file(Vec3 v) { return {100 * v.y, 100 * v.z, 100 * v.x}; }
    static Mat3 to_file(const Mat3& r) {
        const Mat3 p{{0, 1, 0, 0, 0, 1, 1, 0, 0}};  // file from ours
        return p * r * p.transposed();
    }

    void joint(const std::string& keyword, const std::string& name, int segment, Vec3 offset) {
        order_.push_back(segment);
        const Vec3 o = to_file(offset);
        text_ +=
            fmt::format("{} {}\n{{\nOFFSET {} {} {}\nCHANNELS {}Zrotation Xrotation Yrotation\n", keyword,
                        name, o.x, o.y, o.z, segment == kPelvis ? "6 Xposition Yposition Zposition " : "3 ");
        const auto child = [&](const std::string& base, bool left, int next) {
            joint("JOINT", names_.with_side(base, left), next, model_.offset_in_parent(next));
        };
        const auto end = [&](Vec3 at) {
            const Vec3 e = to_file(at);
            text_ += fmt::format("End Site\n{{\nOFFSET {} {} {}\n}}\n", e.x, e.y, e.z);
        };
        const bool left = segment >= kThighL && segment <= kHandL;
        switch (segment) {
            case kPelvis:
                joint("JOINT", names_.spine, kThorax, model_.offset_in_parent(kThorax));
                child(names_.thigh, true, kThighL), child(names_.thigh, false, kThighR);
                break;
            case kThorax:
                joint("JOINT", names_.neck, kHead, model_.offset_in_parent(kHead));
                child(names_.upper_arm, true, kUpperArmL), child(names_.upper_arm, false, kUpperArmR);
                break;
            case kThighL:
            case kThighR:
                child(names_.shin, left, segment + 1);
                break;
            case kShankL:
            case kShankR:
                child(names_.foot, left, segment + 1);
                break;
            case kUpperArmL:
            case kUpperArmR:
                child(names_.forearm, left, segment + 1);
                break;
            case kForearmL:
            case kForearmR:
                child(names_.hand, left, segment + 1);
                break;
            case kFootL:
            case kFootR: {
                const Vec3 toe = to_file(Vec3{0.1, 0, -0.03});
                if (names_.toe.empty()) {
                    end({0.1, 0, -0.03});
                    break;
                }
                text_ += fmt::format(
                    "JOINT {}\n{{\nOFFSET {} {} {}\nCHANNELS 0\nEnd Site\n{{\nOFFSET 0 0 2\n}}\n}}\n",
                    names_.with_side(names_.toe, left), toe.x, toe.y, toe.z);
                break;
            }
            case kHead:
                if (names_.head.empty()) {
                    end({0, 0, 0.15});
                    break;
                }
                text_ += fmt::format(
                    "JOINT {}\n{{\nOFFSET 0 0 0\nCHANNELS 0\nEnd Site\n{{\nOFFSET 0 15 0\n}}\n}}\n",
                    names_.head);
                break;
            default:
                end({0, 0, -0.1});
        }
        text_ += "}\n";
    }

    const BodyModel& model_;
    const Names& names_;
    std::string text_;
    std::vector<int> order_;
};

class Bvh : public ::testing::Test {
  protected:
    const BodyModel model{default_body_shape()};
    std::vector<BodyCoordinates> poses() {
        std::vector<BodyCoordinates> out;
        for (int n = 0; n < 40; ++n) {
            out.push_back(unseen_pose(n));
            out.back()[0] = 0.3 * n, out.back()[2] = 0.9, out.back()[kDofRootRotation + 2] = 0.4 * n;
            out.back()[kDofWristL] = out.back()[kDofWristR] = 0;  // a hand's place says nothing of it
        }
        return out;
    }
    // How far the joints are off, without neck and what lies beyond it and without the girdle's movement.
    double error(BodyCoordinates truth, BodyCoordinates got) {
        for (int dof : {0, 1, 2, kDofRootRotation + 2}) truth[dof] = 0;
        return mean_joint_distance(model, truth, got);
    }
};

TEST_F(Bvh, RoundTripsPoses) {
    const std::vector<BodyCoordinates> truth = poses();
    for (const Names& names : {kMixamo, kDotted, kOwn}) {
        const auto motion = parse_bvh(BvhFile(model, names).text(truth), "test.bvh");
        ASSERT_TRUE(motion.ok()) << motion.status();
        EXPECT_EQ(motion->frames, 40);
        const auto got = poses_from_bvh(*motion, "mine", {.interval_s = 0});
        ASSERT_TRUE(got.ok()) << got.status();
        ASSERT_EQ(got->size(), truth.size());
        double sum = 0;
        for (std::size_t n = 0; n < truth.size(); ++n) {
            const double off = error(truth[n], (*got)[n].coordinates);
            EXPECT_LT(off, 0.06) << n;
            sum += off;
            EXPECT_NEAR((*got)[n].coordinates[kDofKneeL], truth[n][kDofKneeL], 0.02) << n;
            EXPECT_NEAR((*got)[n].coordinates[kDofAnkleR], truth[n][kDofAnkleR], 0.02) << n;
            EXPECT_NEAR((*got)[n].coordinates[kDofElbowR], truth[n][kDofElbowR], 0.02) << n;
        }
        EXPECT_LT(sum / static_cast<double>(truth.size()), 0.025);
        EXPECT_EQ((*got)[3].label, "mine, 0.15 s");
    }
}

TEST_F(Bvh, SamplesPosesAtInterval) {
    const auto motion = parse_bvh(BvhFile(model, kMixamo).text(poses()), "test.bvh");
    ASSERT_TRUE(motion.ok());
    EXPECT_EQ(poses_from_bvh(*motion, "m", {.interval_s = 0.1})->size(), 20u);
    EXPECT_EQ(poses_from_bvh(*motion, "m", {.interval_s = 100})->size(), 1u);
    EXPECT_EQ(poses_from_bvh(*motion, "m", {.interval_s = 0, .max_poses = 7})->size(), 7u);
    EXPECT_FALSE(poses_from_bvh(*motion, "", {}).ok());
    EXPECT_FALSE(poses_from_bvh(*motion, "m", {.interval_s = NAN}).ok());
}

TEST_F(Bvh, ErrorsNameUnknownAndMissingJoints) {
    std::string text = BvhFile(model, kMixamo).text(poses());
    const auto renamed = [&](const std::string& from, const std::string& to) {
        std::string out = text;
        out.replace(out.find(from), from.size(), to);
        const auto motion = parse_bvh(out, "test.bvh");
        EXPECT_TRUE(motion.ok()) << motion.status();
        return std::string(poses_from_bvh(*motion, "mine").status().message());
    };
    const std::string tail = renamed("mixamorig:LeftToeBase", "Tail");
    EXPECT_THAT(tail, HasSubstr("unknown joints: 'Tail'"));
    EXPECT_THAT(tail, HasSubstr("mine"));
    EXPECT_THAT(renamed("mixamorig:RightForeArm", "mixamorig:RightHandThumb1"),
                HasSubstr("missing joints: 'right forearm'"));
    EXPECT_THAT(renamed("mixamorig:LeftUpLeg", "mixamorig:LeftWing"), HasSubstr("'mixamorig:LeftWing'"));
    EXPECT_EQ(renamed("mixamorig:RightToeBase", "mixamorig:RightHandIndex2"), "");
}

TEST_F(Bvh, ErrorsNameLine) {
    const std::string good = BvhFile(model, kMixamo).text({poses()[0]});
    const auto error = [&](const std::string& from, const std::string& to) {
        std::string bad = good;
        bad.replace(bad.find(from), from.size(), to);
        return std::string(parse_bvh(bad, "test.bvh").status().message());
    };
    EXPECT_THAT(std::string(parse_bvh("", "empty.bvh").status().message()),
                HasSubstr("empty.bvh:1: the file's end where HIERARCHY"));
    EXPECT_THAT(error("OFFSET 0 0 0", "OFFSET 0 x 0"), HasSubstr("test.bvh:4: 'x' where a number"));
    EXPECT_THAT(error("OFFSET 0 0 0", "OFFSET 0 nan 0"), HasSubstr("'nan' where a number"));
    EXPECT_THAT(error("CHANNELS 6", "CHANNELS 7"), HasSubstr("7 channels"));
    EXPECT_THAT(error("Xposition", "Wposition"), HasSubstr("'Wposition' is not a channel"));
    EXPECT_THAT(error("Frames: 1", "Frames: 9000"), HasSubstr("fewer values"));
    EXPECT_THAT(error("Frames: 1", "Frames: 1e300"), HasSubstr("where a number"));
    EXPECT_THAT(error("Frames: 1", "Frames: 0"), HasSubstr("at least 1"));
    EXPECT_THAT(error("Frame Time: 0.05", "Frame Time: 0"), HasSubstr("not positive"));
    EXPECT_THAT(std::string(parse_bvh(good + " 5", "t").status().message()),
                HasSubstr("after the last frame"));
}

TEST_F(Bvh, SurvivesArbitraryBytes) {
    const std::string good = BvhFile(model, kDotted).text({poses()[0], poses()[1]});
    std::mt19937 random(5);
    int read = 0;
    for (int n = 0; n < 4000; ++n) {
        std::string bad = good;
        for (int change = static_cast<int>(random() % 4); change >= 0; --change) {
            const std::size_t at = random() % bad.size();
            switch (random() % 4) {
                case 0:
                    bad[at] = static_cast<char>(random());
                    break;
                case 1:
                    bad.erase(at, random() % 40);
                    break;
                case 2:
                    bad.insert(at, bad.substr(random() % bad.size(), random() % 60));
                    break;
                default:
                    bad[at] = "{}0123456789-.e \n"[random() % 17];
            }
        }
        const auto motion = parse_bvh(bad, "fuzz");
        if (!motion.ok()) continue;
        const auto got = poses_from_bvh(*motion, "fuzz");
        if (!got.ok()) continue;
        ++read;
        for (const LibraryPose& pose : *got)
            for (const double value : pose.coordinates) ASSERT_TRUE(std::isfinite(value));
    }
    EXPECT_GT(read, 100);
}

}  // namespace
}  // namespace kinevox
