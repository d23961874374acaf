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

// Centres and radii are those of the studio's clothed bodies around their joints, as fractions of the
// lengths: hips, waist and knees are behind the centre of the soft tissue, the shoulder below its centre.
// Those of the shoulder are where fits find its true joint: around the mesh alone they were 9 mm off along
// the arm.

// A trunk is wider than deep: a capsule on either side and one in the centre, as thick as it is deep.
void add_trunk(const BodyShape& s, Surface& surface) {
    const double waist = s[kRootToSacroiliac], shoulders = s[kSacroiliacToShoulders];
    const double waist_y = s[kWaistHalfWidth] - s[kWaistHalfDepth],
                 chest_y = s[kChestHalfWidth] - s[kChestHalfDepth];
    const double hips_x = -kHipsBehindRoot * waist, pelvis_x = hips_x + s[kPelvisHalfDepth] - s[kPelvisBack],
                 waist_x = s[kWaistHalfDepth] - s[kWaistBack], chest_x = s[kChestHalfDepth] - s[kChestBack];
    const double chest_z = 0.775 * shoulders;
    for (const double side : {1.0, 0.0, -1.0}) {
        const double pelvis_y = side * (s[kPelvisHalfWidth] - s[kPelvisHalfDepth]);
        surface.chain(kPelvis, {{pelvis_x, pelvis_y, -0.08 * waist, s[kPelvisHalfDepth]},
                                {hips_x + waist_x, side * waist_y, waist, s[kWaistHalfDepth]}});
        surface.chain(kThorax, {{waist_x, side * waist_y, 0, s[kWaistHalfDepth]},
                                {chest_x, side * chest_y, chest_z, s[kChestHalfDepth]}});
    }
    for (const double side : {1.0, -1.0}) {
        const double shoulder_y = side * s[kShoulderHalfWidth];
        surface.chain(kThorax,
                      {{chest_x, side * chest_y, chest_z, s[kChestHalfDepth]},
                       {-0.12 * shoulders, 0.66 * shoulder_y, 1.116 * shoulders, 1.05 * s[kUpperArmRadius]},
                       {-0.07 * shoulders, 0.16 * shoulder_y, 1.302 * shoulders, s[kNeckRadius]}});
    }
    surface.chain(kThorax, {{chest_x, 0, chest_z, s[kChestHalfDepth]},
                            {-0.07 * shoulders, 0, 1.136 * shoulders, 1.3 * s[kNeckRadius]},
                            {0.045 * shoulders, 0, s[kSacroiliacToSkullbase], s[kNeckRadius]}});
}

void add_head(const BodyShape& s, Surface& surface) {
    const double top = s[kSkullbaseToHeadTop], radius = s[kHeadRadius];
    surface.chain(kHead,
                  {{0.23 * radius, 0, 0, 0.78 * radius}, {-0.08 * radius, 0, 1.06 * top - radius, radius}});
    surface.chain(kHead, {{0.72 * radius, 0, -0.36 * radius, 0.47 * radius},
                          {0.35 * radius, 0, 1.13 * top - 1.02 * radius, 0.88 * radius}});
    // Long hair, a knot or a tail; short hair is within the head.
    const double back = s[kHairBack];
    surface.chain(kHead, {{-0.6 * radius - back, 0, 0.35 * top, 0.42 * radius},
                          {-0.77 * radius - back, 0, 0.35 * top - 2 * back, 0.25 * radius}});
}

void add_leg(const BodyShape& s, double side, int thigh, int shank, int foot, Surface& surface) {
    const double t = s[kThigh], heel = s[kFootRadius], sole = s[kAnkleHeight], toe = s[kAnkleToToe];
    surface.chain(thigh, {{-0.03 * t, -0.08 * side * t, -0.05 * t, 0.89 * s[kThighRadius]},
                          {0.05 * t, -0.03 * side * t, -0.25 * t, s[kThighRadius]},
                          {0.05 * t, -0.03 * side * t, -0.5 * t, 0.95 * s[kThighRadius]},
                          {0.008 * t, -0.013 * side * t, -t, s[kKneeRadius]}});
    surface.chain(shank, {{-0.01 * s[kShank], 0, 0, s[kKneeRadius]},
                          {-0.063 * s[kShank], 0.025 * side * s[kShank], -0.28 * s[kShank], s[kCalfRadius]},
                          {-0.016 * s[kShank], 0.014 * side * s[kShank], -s[kShank], s[kAnkleRadius]}});
    for (const double half : {0.1, -0.1})  // of the foot's width: it is wider than high
        surface.chain(
            foot, {{-0.11 * toe, (0.04 - 0.11 * kToeOut) * side * toe, heel - sole, heel},
                   {0.61 * toe, (half + 0.04 + 0.61 * kToeOut) * side * toe, 0.7 * heel - sole, 0.7 * heel},
                   {toe - 0.45 * heel, (0.6 * half - 0.045 + 0.95 * kToeOut) * side * toe, 0.48 * heel - sole,
                    0.45 * heel}});
    surface.chain(foot, {{0.01 * toe, 0.013 * side * toe, 0, s[kAnkleRadius]},
                         {0.52 * toe, 0.52 * kToeOut * side * toe, 0.8 * heel - sole, 0.81 * heel}});
}

void add_arm(const BodyShape& s, double side, int upper_arm, int forearm, int hand, Surface& surface) {
    const double u = s[kUpperArm];
    surface.chain(upper_arm, {{-0.045 * u, -0.08 * side * u, 0.125 * u, 1.18 * s[kUpperArmRadius]},
                              {-0.05 * u, 0, -0.29 * u, s[kUpperArmRadius]},
                              {0.005 * u, -0.027 * side * u, -u, s[kElbowRadius]}});
    surface.chain(forearm,
                  {{0.005 * u, -0.027 * side * u, 0, s[kElbowRadius]},
                   {0.006 * s[kForearm], -0.01 * side * s[kForearm], -0.25 * s[kForearm], s[kForearmRadius]},
                   {0, 0.008 * side * s[kForearm], -s[kForearm], s[kWristRadius]}});
    surface.chain(hand, {{0, 0.008 * side * s[kForearm], 0, s[kWristRadius]},
                         {(0.02 - 0.45 * kHandBack) * s[kHand], -0.07 * side * s[kHand], -0.45 * s[kHand],
                          s[kHandRadius]},
                         {-kHandBack * s[kHand], 0, 0.5 * s[kHandRadius] - s[kHand], 0.5 * s[kHandRadius]}});
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
