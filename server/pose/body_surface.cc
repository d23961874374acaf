#include "server/pose/body_surface.h"

namespace kinevox {
namespace {

struct Point {
    double x, y, z, radius;
};

class Surface {
  public:
    void chain(int segment, std::initializer_list<Point> points) {
        const Point* last = nullptr;
        for (const Point& p : points) {
            if (last) capsules_.push_back(capsule(segment, *last, p));
            last = &p;
        }
    }
    std::vector<BodyCapsule> take() { return std::move(capsules_); }

  private:
    static BodyCapsule capsule(int segment, const Point& a, const Point& b) {
        BodyCapsule c;
        c.segment = segment;
        c.a[0] = static_cast<float>(a.x), c.a[1] = static_cast<float>(a.y), c.a[2] = static_cast<float>(a.z);
        c.b[0] = static_cast<float>(b.x), c.b[1] = static_cast<float>(b.y), c.b[2] = static_cast<float>(b.z);
        c.radius_a = static_cast<float>(a.radius), c.radius_b = static_cast<float>(b.radius);
        return c;
    }
    std::vector<BodyCapsule> capsules_;
};

// Centres and radii are those of the studio's clothed bodies around their joints, as parts of the lengths: hips, waist and
// knees lie behind the middle of the flesh, the shoulder below the middle of its own.

// A trunk is wider than deep: a capsule on either side and one in the middle, as thick as it is deep.
void add_trunk(const BodyShape& s, Surface& surface) {
    const double waist = s[kRootToWaist], shoulders = s[kWaistToShoulders];
    const double waist_y = s[kWaistHalfWidth] - s[kWaistHalfDepth], chest_y = s[kChestHalfWidth] - s[kChestHalfDepth];
    for (const double side : {1.0, 0.0, -1.0}) {
        const double pelvis_y = side * (s[kPelvisHalfWidth] - s[kPelvisHalfDepth]);
        surface.chain(kPelvis, {{0.07 * waist, pelvis_y, -0.2 * waist, s[kPelvisHalfDepth]},
                                {0.24 * waist, side * waist_y, waist, s[kWaistHalfDepth]}});
        surface.chain(kThorax, {{0.16 * shoulders, side * waist_y, 0, s[kWaistHalfDepth]},
                                {0.06 * shoulders, side * chest_y, 0.7 * shoulders, s[kChestHalfDepth]}});
    }
    for (const double side : {1.0, -1.0}) {
        const double shoulder_y = side * s[kShoulderHalfWidth];
        surface.chain(kThorax, {{0.06 * shoulders, side * chest_y, 0.7 * shoulders, s[kChestHalfDepth]},
                                {-0.03 * shoulders, 0.65 * shoulder_y, 1.04 * shoulders, s[kUpperArmRadius]},
                                {-0.06 * shoulders, 0.15 * shoulder_y, 1.25 * shoulders, s[kNeckRadius]}});
    }
    surface.chain(kThorax, {{0.06 * shoulders, 0, 0.7 * shoulders, s[kChestHalfDepth]},
                            {-0.05 * shoulders, 0, 1.1 * shoulders, 1.3 * s[kNeckRadius]},
                            {0.05 * shoulders, 0, s[kWaistToSkullbase], s[kNeckRadius]}});
}

void add_head(const BodyShape& s, Surface& surface) {
    const double top = s[kSkullbaseToTop], radius = s[kHeadRadius];
    surface.chain(kHead, {{0.25 * radius, 0, 0, 0.8 * radius}, {0.1 * radius, 0, top - radius, radius}});
    surface.chain(kHead, {{0.75 * radius, 0, -0.35 * radius, 0.5 * radius}, {0.4 * radius, 0, top - 1.1 * radius, 0.9 * radius}});
}

void add_leg(const BodyShape& s, double side, int thigh, int shank, int foot, Surface& surface) {
    const double t = s[kThigh], heel = s[kFootRadius], sole = s[kAnkleHeight], toe = s[kAnkleToToe];
    surface.chain(thigh, {{0.01 * t, -0.04 * side * t, -0.02 * t, 0.88 * s[kThighRadius]},
                          {0.03 * t, -0.01 * side * t, -0.25 * t, s[kThighRadius]},
                          {0.05 * t, 0, -0.5 * t, 0.97 * s[kThighRadius]},
                          {0.012 * t, 0, -t, s[kKneeRadius]}});
    surface.chain(shank, {{-0.012 * s[kShank], 0, 0, s[kKneeRadius]},
                          {-0.055 * s[kShank], 0, -0.28 * s[kShank], s[kCalfRadius]},
                          {-0.02 * s[kShank], 0, -s[kShank], s[kAnkleRadius]}});
    for (const double half : {0.1, -0.1})   // of the foot's width: it is wider than high
        surface.chain(foot, {{-0.2 * toe, 0, heel - sole, heel},
                             {0.62 * toe, half * toe, 0.7 * heel - sole, 0.7 * heel},
                             {toe - 0.45 * heel, 0.6 * half * toe, 0.5 * heel - sole, 0.45 * heel}});
    surface.chain(foot, {{-0.02 * toe, 0, 0, s[kAnkleRadius]}, {0.5 * toe, 0, 0.8 * heel - sole, 0.8 * heel}});
}

void add_arm(const BodyShape& s, double side, int upper_arm, int forearm, int hand, Surface& surface) {
    const double u = s[kUpperArm];
    surface.chain(upper_arm, {{-0.03 * u, -0.07 * side * u, 0.1 * u, 1.15 * s[kUpperArmRadius]},
                              {-0.02 * u, 0, -0.3 * u, s[kUpperArmRadius]},
                              {0, 0, -u, s[kElbowRadius]}});
    surface.chain(forearm, {{0, 0, 0, s[kElbowRadius]},
                            {0, 0, -0.25 * s[kForearm], s[kForearmRadius]},
                            {0, 0, -s[kForearm], s[kWristRadius]}});
    surface.chain(hand, {{0, 0, 0, s[kWristRadius]},
                         {0, 0, -0.45 * s[kHand], s[kHandRadius]},
                         {0, 0, 0.5 * s[kHandRadius] - s[kHand], 0.5 * s[kHandRadius]}});
}

}  // namespace

std::vector<BodyCapsule> body_surface(const BodyShape& shape) {
    Surface surface;
    add_trunk(shape, surface);
    add_head(shape, surface);
    add_leg(shape, 1, kThighL, kShankL, kFootL, surface);
    add_leg(shape, -1, kThighR, kShankR, kFootR, surface);
    add_arm(shape, 1, kUpperArmL, kForearmL, kHandL, surface);
    add_arm(shape, -1, kUpperArmR, kForearmR, kHandR, surface);
    return surface.take();
}

}  // namespace kinevox
