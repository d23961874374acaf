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

// A trunk is wider than deep: a capsule on either side and one in the middle, as thick as it is deep.
void add_trunk(const BodyShape& s, Surface& surface) {
    const double waist = s[kRootToWaist], shoulders = s[kWaistToShoulders];
    for (const double side : {1.0, 0.0, -1.0}) {
        const double pelvis_y = side * (s[kPelvisHalfWidth] - s[kPelvisHalfDepth]);
        const double waist_y = side * (s[kWaistHalfWidth] - s[kWaistHalfDepth]);
        const double chest_y = side * (s[kChestHalfWidth] - s[kChestHalfDepth]);
        surface.chain(kPelvis, {{-0.05 * waist, pelvis_y, -0.2 * waist, s[kPelvisHalfDepth]},
                                {0, waist_y, waist, s[kWaistHalfDepth]}});
        surface.chain(kThorax, {{0, waist_y, 0, s[kWaistHalfDepth]}, {0, chest_y, 0.6 * shoulders, s[kChestHalfDepth]}});
    }
    for (const double side : {1.0, -1.0}) {
        const double chest_y = side * (s[kChestHalfWidth] - s[kChestHalfDepth]);
        const double shoulder_y = side * s[kShoulderHalfWidth];
        surface.chain(kThorax, {{0, chest_y, 0.6 * shoulders, s[kChestHalfDepth]},
                                {-0.02 * shoulders, 0.65 * shoulder_y, 0.93 * shoulders, 0.9 * s[kUpperArmRadius]}});
        surface.chain(kThorax, {{-0.02 * shoulders, 0.65 * shoulder_y, 0.97 * shoulders, 0.8 * s[kUpperArmRadius]},
                                {-0.05 * shoulders, 0.15 * shoulder_y, 1.2 * shoulders, s[kNeckRadius]}});
    }
    surface.chain(kThorax, {{0, 0, 0.6 * shoulders, s[kChestHalfDepth]},
                            {-0.03 * shoulders, 0, 1.02 * shoulders, 1.2 * s[kNeckRadius]},
                            {0, 0, s[kWaistToSkullbase], s[kNeckRadius]}});
}

void add_head(const BodyShape& s, Surface& surface) {
    const double top = s[kSkullbaseToTop], radius = s[kHeadRadius];
    surface.chain(kHead, {{0, 0, 0, 0.8 * radius}, {0, 0, top - radius, radius}});
    surface.chain(kHead, {{0.5 * radius, 0, -0.45 * radius, 0.6 * radius}, {0.4 * radius, 0, top - 1.1 * radius, 0.95 * radius}});
}

void add_leg(const BodyShape& s, int thigh, int shank, int foot, Surface& surface) {
    const double heel = s[kFootRadius], sole = s[kAnkleHeight], toe = s[kAnkleToToe];
    surface.chain(thigh, {{0, 0, 0, 1.05 * s[kThighRadius]},
                          {0, 0, -0.25 * s[kThigh], s[kThighRadius]},
                          {0, 0, -s[kThigh], s[kKneeRadius]}});
    surface.chain(shank, {{0, 0, 0, s[kKneeRadius]},
                          {-0.2 * s[kCalfRadius], 0, -0.28 * s[kShank], s[kCalfRadius]},
                          {0, 0, -s[kShank], s[kAnkleRadius]}});
    surface.chain(foot, {{-0.2 * toe, 0, heel - sole, heel},
                         {0.65 * toe, 0, 0.9 * heel - sole, 0.9 * heel},
                         {toe - 0.6 * heel, 0, 0.6 * heel - sole, 0.6 * heel}});
    surface.chain(foot, {{0, 0, 0, s[kAnkleRadius]}, {0.5 * toe, 0, 0.9 * heel - sole, 0.9 * heel}});
}

void add_arm(const BodyShape& s, int upper_arm, int forearm, int hand, Surface& surface) {
    surface.chain(upper_arm, {{0, 0, 0, 1.1 * s[kUpperArmRadius]},
                              {0, 0, -0.25 * s[kUpperArm], s[kUpperArmRadius]},
                              {0, 0, -s[kUpperArm], s[kElbowRadius]}});
    surface.chain(forearm, {{0, 0, 0, s[kElbowRadius]},
                            {0, 0, -0.25 * s[kForearm], s[kForearmRadius]},
                            {0, 0, -s[kForearm], s[kWristRadius]}});
    surface.chain(hand, {{0, 0, 0, s[kWristRadius]},
                         {0, 0, -0.45 * s[kHand], s[kHandRadius]},
                         {0, 0, 0.45 * s[kHandRadius] - s[kHand], 0.45 * s[kHandRadius]}});
}

}  // namespace

std::vector<BodyCapsule> body_surface(const BodyShape& shape) {
    Surface surface;
    add_trunk(shape, surface);
    add_head(shape, surface);
    add_leg(shape, kThighL, kShankL, kFootL, surface);
    add_leg(shape, kThighR, kShankR, kFootR, surface);
    add_arm(shape, kUpperArmL, kForearmL, kHandL, surface);
    add_arm(shape, kUpperArmR, kForearmR, kHandR, surface);
    return surface.take();
}

}  // namespace kinevox
