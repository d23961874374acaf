// Colours within the silhouettes, and what they say about an arm before the trunk.
#include "server/pose/body_colours.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <vector>

#include "common/body_pose.h"
#include "common/geometry.h"
#include "server/pose/arm_search.h"
#include "server/pose/ray_capsule.h"
#include "server/pose/turned_posture.h"
#include "server/pose/view_colours.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

using Colour = std::array<std::uint8_t, 3>;
constexpr Colour kShirt{60, 60, 150}, kTrousers{90, 60, 30}, kSkin{120, 150, 200};

Colour colour_of(int segment, Colour sleeve) {
    switch (segment) {
        case kThorax:
            return kShirt;
        case kUpperArmL:
        case kUpperArmR:
        case kForearmL:
        case kForearmR:
            return sleeve;
        case kHead:
        case kHandL:
        case kHandR:
            return kSkin;
        default:
            return kTrousers;
    }
}

// What a camera sees of painted capsules.
struct Picture {
    std::vector<std::uint8_t> pixels;
    kernels::Silhouettes silhouettes;
    kernels::ImageView view() const {
        return {pixels.data(), silhouettes.width, silhouettes.height, 3, 3 * silhouettes.width};
    }
};
Picture paint(const Camera& camera, const std::vector<BodyCapsule>& capsules, Colour sleeve) {
    Picture picture{{}, testing::silhouette_of(camera, capsules)};
    picture.pixels.assign(3 * picture.silhouettes.sharp.size(), 0);
    const Vec3 origin = camera.centre_in_world();
    for (int y = picture.silhouettes.bounds.y0; y < picture.silhouettes.bounds.y1; ++y)
        for (int x = picture.silhouettes.bounds.x0; x < picture.silhouettes.bounds.x1; ++x) {
            const std::size_t at = static_cast<std::size_t>(y) * camera.width + x;
            if (!picture.silhouettes.sharp[at]) continue;
            const Vec3 direction =
                camera.ray_through({static_cast<double>(x), static_cast<double>(y)}).direction_in_world;
            double nearest = std::numeric_limits<double>::infinity();
            for (const BodyCapsule& capsule : capsules) {
                const RayTouch touch = touch_ray(origin, direction, {}, capsule);
                if (!(touch.distance < 0)) continue;
                const double depth = norm(touch.point - origin) + touch.distance;
                if (depth >= nearest) continue;
                nearest = depth;
                const Colour colour = colour_of(capsule.segment, sleeve);
                std::copy(colour.begin(), colour.end(), picture.pixels.begin() + 3 * at);
            }
        }
    return picture;
}

class BodyColoursTest : public ::testing::Test {
  protected:
    std::vector<SilhouetteRays> see(const BodyCoordinates& q, Colour sleeve = kSkin) const {
        std::vector<SilhouetteRays> views(scene_.cameras.size());
        for (std::size_t c = 0; c < views.size(); ++c) {
            const Picture picture =
                paint(scene_.cameras[c], capsules_of(posture_from_coordinates(q)), sleeve);
            read_silhouette(scene_.cameras[c], picture.silhouettes, {}, views[c]);
            read_colours(picture.view(), picture.silhouettes, 112, views[c].colours);
        }
        return views;
    }
    std::vector<BodyCapsule> capsules_of(const BodyPosture& posture) const {
        std::vector<BodyCapsule> capsules;
        scene_.model->capsules(scene_.model->forward(posture), capsules);
        return capsules;
    }
    // Learns from arms that point forwards and to the side.
    BodyColours learned(Colour sleeve = kSkin) const {
        std::vector<std::vector<SilhouetteRays>> seen;
        std::vector<BodyColours::Example> examples;
        for (const BodyCoordinates& q : {scene_.standing(), scene_.t_pose()}) {
            seen.push_back(see(q, sleeve));
            examples.push_back({{}, capsules_of(posture_from_coordinates(q))});
        }
        for (std::size_t n = 0; n < seen.size(); ++n) examples[n].views = seen[n];
        BodyColours colours;
        colours.learn(examples);
        return colours;
    }
    // The left forearm before the trunk.
    BodyCoordinates folded() const {
        BodyCoordinates q = scene_.standing();
        q[kDofShoulderL] = radians(15), q[kDofShoulderL + 1] = radians(-5),
        q[kDofShoulderL + 2] = radians(60);
        q[kDofElbowL] = radians(95);
        return q;
    }

    testing::SeenBody scene_{.cameras = testing::camera_ring(3)};
};

TEST(ViewColours, AveragesThePixelsOfTheSilhouetteInEachCell) {
    kernels::Silhouettes seen;
    seen.width = 40, seen.height = 30;
    seen.sharp.assign(40 * 30, 0);
    std::vector<std::uint8_t> pixels(3 * seen.sharp.size(), 255);
    for (int y = 10; y < 30; ++y)
        for (int x = 4; x < 14; ++x) {
            const std::size_t at = static_cast<std::size_t>(y) * 40 + x;
            seen.sharp[at] = 255, ++seen.sharp_pixels;
            pixels[3 * at] = 10, pixels[3 * at + 1] = 20, pixels[3 * at + 2] = y < 20 ? 30 : 90;
        }
    seen.bounds = {4, 10, 16, 30};  // of the loose one: wider
    ViewColours colours;
    read_colours({pixels.data(), 40, 30, 3, 120}, seen, 10, colours);
    ASSERT_EQ(colours.cell, 2);
    ASSERT_EQ(colours.columns, 6);
    ASSERT_EQ(colours.rows, 10);
    EXPECT_EQ(colours.colour[0], (Colour{10, 20, 30}));
    EXPECT_EQ(colours.colour[6 * 9 + 4], (Colour{10, 20, 90}));
    EXPECT_EQ(colours.inside[4], 1);
    EXPECT_EQ(colours.inside[5], 0) << "outside the sharp silhouette";
    read_colours({}, seen, 10, colours);
    EXPECT_TRUE(colours.empty());
}

TEST_F(BodyColoursTest, PreferTheArmThatShowsItsSkin) {
    const BodyColours colours = learned();
    const BodyPosture truth = posture_from_coordinates(folded());
    const auto views = see(folded());
    const double right = colours.cost(views, capsules_of(truth));
    int compared = 0;
    for (const SilhouetteRays& view : views)
        for (const double angle : {-1.0, 1.0})
            if (const auto turned =
                    forearm_turned(*scene_.model, truth, kForearmL, view.contour.origin_in_world, angle)) {
                EXPECT_GT(colours.cost(views, capsules_of(*turned)), right + 10);
                ++compared;
            }
    EXPECT_GE(compared, 3);
}

TEST_F(BodyColoursTest, AreSilentAboutAnArmOfTheTrunksColour) {
    const BodyColours colours = learned(kShirt);
    const BodyPosture truth = posture_from_coordinates(folded());
    const auto views = see(folded(), kShirt);
    BodyPosture other = truth;  // within the trunk's silhouette
    other.parent_from_segment[kForearmL] = other.parent_from_segment[kForearmL] * rotation_z(radians(20));
    other.parent_from_segment[kHandL] = rotation_x(radians(40));
    EXPECT_NEAR(colours.cost(views, capsules_of(other)), colours.cost(views, capsules_of(truth)), 25);
}

TEST_F(BodyColoursTest, CostNothingWithoutImages) {
    const std::vector<SilhouetteRays> views = scene_.see(folded());
    const std::vector<BodyCapsule> capsules = capsules_of(posture_from_coordinates(folded()));
    BodyColours colours;
    EXPECT_EQ(colours.cost(views, capsules), 0) << "nothing learned";
    colours.learn(std::vector<BodyColours::Example>{{views, capsules}});
    EXPECT_EQ(colours.cost(views, capsules), 0);
    EXPECT_EQ(learned().cost(views, capsules), 0);
}

TEST_F(BodyColoursTest, AddedExamplesCountAsLearnedOnes) {
    const BodyColours learned_at_once = learned();
    BodyColours added;
    for (int n = 0; n < 3; ++n)
        for (const BodyCoordinates& q : {scene_.standing(), scene_.t_pose()})
            added.add(see(q), capsules_of(posture_from_coordinates(q)));
    const auto views = see(folded());
    const std::vector<BodyCapsule> right = capsules_of(posture_from_coordinates(folded())),
                                   wrong = capsules_of(posture_from_coordinates(scene_.standing()));
    const double gain = learned_at_once.cost(views, wrong) - learned_at_once.cost(views, right);
    ASSERT_GT(gain, 20);
    EXPECT_GT(added.cost(views, wrong) - added.cost(views, right), 0.7 * gain);
    added.clear();
    EXPECT_EQ(added.cost(views, right), 0);
}

// Their clothes would be learned.
TEST_F(BodyColoursTest, AddIgnoresViewsThatShowOthers) {
    const BodyPosture posture = posture_from_coordinates(scene_.standing());
    const std::vector<BodyCapsule> capsules = capsules_of(posture);
    const auto cost_after_views_with_others = [&](std::size_t with_others) {
        std::vector<SilhouetteRays> views = see(scene_.standing());
        for (std::size_t c = 0; c < with_others; ++c) {
            const Picture picture = paint(scene_.cameras[c], capsules, kSkin);
            ForegroundPart shared{std::vector<std::uint8_t>(picture.silhouettes.sharp.size(), 0),
                                  picture.silhouettes.bounds};
            for (int x = shared.box.x0; x < shared.box.x1; ++x)
                shared.mask[static_cast<std::size_t>(shared.box.y0) * picture.silhouettes.width + x] = 255;
            read_silhouette(scene_.cameras[c], picture.silhouettes, {}, views[c], {}, &shared);
        }
        BodyColours colours;
        colours.add(views, capsules);
        return colours.cost(views, capsules);
    };
    EXPECT_LT(cost_after_views_with_others(0), cost_after_views_with_others(1));
    EXPECT_LT(cost_after_views_with_others(1), 0);
    EXPECT_EQ(cost_after_views_with_others(scene_.cameras.size()), 0);
}

TEST_F(BodyColoursTest, PartialCostIsThatOfTheWholeBody) {
    const BodyColours colours = learned();
    const auto views = see(folded());
    const auto is_arm = [](const BodyCapsule& c) {
        return c.segment == kUpperArmL || c.segment == kForearmL || c.segment == kHandL;
    };
    std::vector<BodyCapsule> rest = capsules_of(posture_from_coordinates(folded()));
    std::erase_if(rest, is_arm);
    const double without = colours.cost(views, rest);
    PartialColourCost partial(colours, views, rest);
    for (const BodyCoordinates& q : {folded(), scene_.standing(), folded()}) {
        BodyPosture posture = posture_from_coordinates(folded());
        for (const int s : {kUpperArmL, kForearmL, kHandL})
            posture.parent_from_segment[s] = posture_from_coordinates(q).parent_from_segment[s];
        const std::vector<BodyCapsule> whole = capsules_of(posture);
        std::vector<BodyCapsule> arm;
        std::ranges::copy_if(whole, std::back_inserter(arm), is_arm);
        EXPECT_NEAR(without + partial.cost(arm), colours.cost(views, whole), 1e-3);
    }
}

TEST_F(BodyColoursTest, ArmSearchFindsTheForearmBeforeTheTrunk) {
    const BodyColours colours = learned();
    const BodyPosture truth = posture_from_coordinates(folded());
    const auto views = see(folded());
    constexpr std::size_t kHand = *joint_index("hand_l"), kElbow = *joint_index("elbow_l");
    const JointPositions expected = scene_.model->forward(truth).joints_in_world;
    const auto error = [&](const BodyPosture& posture, std::size_t joint) {
        return norm(scene_.model->forward(posture).joints_in_world[joint] - expected[joint]);
    };
    for (const double angle : {-0.6, 0.6}) {
        const BodyPosture start = forearm_moved(truth, kForearmL, angle, 0.3);
        ASSERT_GT(error(start, kHand), 0.12);
        ArmSearch search(*scene_.model, start, Limb::kArmL, views, colours, PoseFitOptions{});
        search.improve(std::array{0.6, 0.3, 0.15}, 4);
        EXPECT_GT(search.gain(), 0);
        EXPECT_LT(error(search.best().posture, kHand), 0.06) << angle;
        EXPECT_LT(error(search.best().posture, kElbow), 0.04) << angle;
        double least = std::numeric_limits<double>::infinity();
        for (const MovedArm& moved : search.around(0.6)) least = std::min(least, moved.total());
        EXPECT_GT(least, search.best().total() + 10) << "colours determine this arm";
    }
}

TEST_F(BodyColoursTest, ArmSearchAnywhereFindsAnArmFarFromItsStart) {
    const BodyColours colours = learned();
    const BodyPosture truth = posture_from_coordinates(folded());
    const auto views = see(folded());
    constexpr std::size_t kWrist = *joint_index("wrist_l");
    const Vec3 expected = scene_.model->forward(truth).joints_in_world[kWrist];
    const auto error = [&](const BodyPosture& posture) {
        return norm(scene_.model->forward(posture).joints_in_world[kWrist] - expected);
    };
    BodyPosture start = truth;
    for (const int s : {kUpperArmL, kForearmL, kHandL})
        start.parent_from_segment[s] = posture_from_coordinates(scene_.standing()).parent_from_segment[s];
    LimbSearch limbs;
    constexpr std::array kAngles{0.6, 0.3, 0.15};
    ArmSearch search(*scene_.model, start, Limb::kArmL, views, colours, PoseFitOptions{});
    search.improve(kAngles, 4);
    ASSERT_GT(error(search.best().posture), 0.3) << "near the start is no arm that the colours allow";
    ArmSearch from_few = search;
    from_few.improve_anywhere(limbs, kAngles, 4, 3);
    EXPECT_LT(error(from_few.best().posture), 0.03);
    search.improve_anywhere(limbs, kAngles, 4);
    EXPECT_LT(error(search.best().posture), 0.035) << "the finest angle moves the wrist by as much";
}

TEST_F(BodyColoursTest, ElbowSwivelsAroundTheLineFromShoulderToWrist) {
    const BodyPosture start = posture_from_coordinates(folded());
    const PosedBody before = scene_.model->forward(start),
                    after = scene_.model->forward(elbow_swivelled(*scene_.model, start, kUpperArmL, 0.5));
    const auto moved = [&](int segment) {
        return norm(after.world_from_segment[segment].translation -
                    before.world_from_segment[segment].translation);
    };
    EXPECT_LT(moved(kUpperArmL), 0.01) << "the shoulder follows the elbow a little";
    EXPECT_LT(moved(kHandL), 0.01);
    EXPECT_GT(moved(kForearmL), 0.03);
}

TEST_F(BodyColoursTest, ForearmTurnedKeepsElbowAndDirectionInTheImage) {
    const BodyPosture truth = posture_from_coordinates(folded());
    const PosedBody before = scene_.model->forward(truth);
    const Camera& camera = scene_.cameras[0];
    const auto turned =
        forearm_turned(*scene_.model, truth, kForearmL, camera.centre_in_world(), radians(30));
    ASSERT_TRUE(turned);
    const PosedBody after = scene_.model->forward(*turned);
    const auto elbow = [](const PosedBody& b) { return b.world_from_segment[kForearmL].translation; };
    const auto wrist = [](const PosedBody& b) { return b.world_from_segment[kHandL].translation; };
    EXPECT_LT(norm(elbow(after) - elbow(before)), 1e-6);
    const Vec3 away = normalized(elbow(before) - camera.centre_in_world());
    const auto depth = [&](const PosedBody& b) {
        return std::asin(dot(normalized(wrist(b) - elbow(b)), away));
    };
    EXPECT_NEAR(depth(after) - depth(before), radians(30), 1e-6);
    const auto in_image = [&](const PosedBody& b) {
        const Vec3 v = wrist(b) - elbow(b);
        return normalized(v - dot(v, away) * away);
    };
    EXPECT_GT(dot(in_image(before), in_image(after)), 1 - 1e-9);
    EXPECT_FALSE(forearm_turned(*scene_.model, truth, kForearmL, camera.centre_in_world(), radians(170)));
}

}  // namespace
}  // namespace kinevox
