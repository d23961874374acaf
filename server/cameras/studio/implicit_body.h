// The person's surface as a signed distance: a smooth union of tapered, flattened capsules that ride on the
// rig's bones, with clothes as an outward offset. Defined in the rig's rest pose. Round cones after I.
// Quilez, "Distance functions"; the smooth minimum is the quadratic one there.
#pragma once

#include <vector>

#include "server/cameras/studio/rig.h"
#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

enum class Material : unsigned char {
    kSkin,
    kHair,
    kShirt,
    kTrousers,
    kShoe,
    kSole,
    kSock,
    kEye,
    kBrow,
    kLips
};

class ImplicitBody {
  public:
    ImplicitBody(const Rig& rig, const Subject& subject);

    struct Sample {
        float distance;  // m to the clothed surface, negative inside; exact enough near 0
        Bone nearest;    // whose primitive is nearest
    };
    Sample sample(Vec3f rest) const;
    float distance(Vec3f rest) const { return sample(rest).distance; }

    // Per bone, the distance to its own primitives alone; 1 m for a bone without any.
    void bone_distances(Vec3f rest, float (&distance)[kBoneCount]) const;

    // What covers the body there; `nearest` from sample().
    Material material(Vec3f rest, Bone nearest) const;
    Vec3f in_flesh(Vec3f rest, Bone bone) const { return flesh_from_rest_[bone].point(rest); }

    Vec3f lower() const { return lower_; }  // a box that holds the surface, in the rest pose
    Vec3f upper() const { return upper_; }

  private:
    struct Primitive {
        Bone bone;
        Affine3f local_from_rest;  // a at the origin, b on +z, flattened axes scaled up to round
        float ra, rb, length;
        float shrink;  // scaled distances times this never exceed the true ones
        Vec3f centre;  // bounding ball, rest pose
        float radius;
        float blend;  // m, of the smooth union with what came before
    };
    void add(Bone bone, Vec3f a, float ra, Vec3f b, float rb, float flat_x, float flat_y, float blend);
    void add_trunk();
    void add_head();
    void add_limbs(Side side);
    float clothes(Vec3f rest, Bone nearest) const;
    static float primitive_distance(const Primitive& primitive, Vec3f rest);

    const Rig& rig_;
    Subject subject_;
    float unit_;   // stature / 1.8 m
    float girth_;  // times radii
    std::vector<Primitive> primitives_;
    std::array<Affine3f, kBoneCount> flesh_from_rest_;
    std::array<Rigid3, kBoneCount> rest_from_flesh_;
    Vec3f lower_, upper_;
};

}  // namespace kinevox::studio
