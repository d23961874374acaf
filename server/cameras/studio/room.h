// The empty studio: a furnished room, or a hall with a running lane. Lit once into light maps, then drawn
// once for every camera; only the person and the shadow are drawn for every frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/cameras/studio/motion.h"
#include "server/cameras/studio/rig.h"
#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

// The lamps of the studio. One key lamp casts the visible shadow; panels and reflected light fill in. Light
// is relative to that at the centre of the floor.

struct Lamp {
    Vec3f position;            // world, m
    Vec3f power;               // m^2: light at 1 m straight below
    float half_size_m = 0.1f;  // a square of twice this, horizontal
    bool downlight = true;     // gives cos of the angle to the vertical; else the same in all directions
};

// What of the light is chosen; absent values are drawn from the seed.
struct LightOptions {
    double key_fraction = 0.54;        // of the light at the floor's centre; 0 .. 1
    double panels_fraction = 0.22;     // likewise; reflected light is the rest, at least 0.05
    std::optional<Vec3> key_position;  // m, world
    std::optional<double> key_half_m;  // half the side of the key lamp, m; 0.02 .. 1
    double exposure = 1;               // times all light; 0.2 .. 2
    std::optional<Albedo> tint;        // of the key lamp, 0.5 .. 1.5
    // Shadows of the key lamp and the panels as areas and of reflected light, on floor and walls; else the
    // key lamp's on the floor alone, which is drawn faster.
    bool area_shadows = false;

    // Empty when usable, else one sentence.
    std::string check() const;
};

struct Lighting {
    Lamp key;
    std::vector<Lamp> panels;
    Vec3f from_above, from_below;  // ambient light on a surface that faces up, down

    // Light of one lamp on a surface at p with this normal, nothing in between.
    static Vec3f direct(const Lamp& lamp, Vec3f p, Vec3f normal) {
        const Vec3f way = lamp.position - p;
        const float d2 = std::max(dot(way, way), 0.01f), inv = 1.0f / std::sqrt(d2);
        const float cosine = dot(normal, way) * inv;
        if (cosine <= 0) return {};
        const float emission = lamp.downlight ? std::max(way.z * inv, 0.0f) : 1.0f;
        return cosine * emission / d2 * lamp.power;
    }
    Vec3f ambient(Vec3f normal) const {
        const float up = 0.5f + 0.5f * normal.z;
        return up * from_above + (1 - up) * from_below;
    }
};

// Procedural surfaces of the room, in metres on a face; in room_textures.cc.

enum class TextureKind {
    kPaint,
    kBrick,
    kPanelling,
    kWoodFloor,
    kConcrete,
    kTrack,
    kCeiling,
    kShelf,
    kCabinet,
    kWood,
    kCrate,
    kScreen,
    kLamp,
    kMat
};

struct Texture {
    TextureKind kind = TextureKind::kPaint;
    Albedo base;
    std::uint32_t seed = 0;
};

enum class DecalKind { kPoster, kWhiteboard, kDoor, kTape, kLaneLine, kLampPanel };

// A rectangle painted on a face.
struct Decal {
    DecalKind kind;
    float u0, v0, u1, v1;  // m
    Albedo base;
    std::uint32_t seed = 0;
};

// Linear reflectance at (u, v); of a lamp or lamp panel its brightness.
Albedo texture_at(const Texture& texture, float u, float v, float u_length, float v_length);
Albedo decal_at(const Decal& decal, float u, float v);

// What of the room is chosen; absent values are drawn from the seed.
struct RoomOptions {
    std::optional<TextureKind> floor, walls;
    std::optional<Albedo> floor_colour, wall_colour;
    double floor_grain = 1, wall_grain = 1;  // contrast of their textures; 0: plain; 0 .. 2
    bool furniture = true;                   // along the walls
    bool decals = true;                      // posters, boards, doors, tape and lines

    // Empty when usable, else one sentence.
    std::string check() const;
};

inline constexpr int kGreyScale = 160;  // images before the sensor: grey levels times this, 16 bits

// The empty room as seen by one camera.
struct RoomView {
    int width = 0, height = 0;
    std::vector<std::uint16_t> bgr;  // height * width * 3
    // Per pixel: the shell's face seen there (0: floor, 2..5: walls), kNoFace: anything else; and where, 2
    // values: world x, y of the floor, u, v of a wall, m; NaN: elsewhere.
    static constexpr std::uint8_t kNoFace = 255;
    std::vector<std::uint8_t> face;
    std::vector<float> at;
};

class Room {
  public:
    Room(Stage stage, std::uint32_t seed, const RoomOptions& options = {}, const LightOptions& light = {});

    const Lighting& lighting() const { return lighting_; }
    RoomView draw(const Camera& camera) const;

    struct Box {
        Vec3f centre, half;  // m, before turning
        float yaw_cos = 1, yaw_sin = 0;
        Texture texture;
    };
    // A rectangle of the room's shell or of a box, with its light map.
    struct Face {
        Vec3f origin, along_u, along_v, normal;  // u, v of length 1
        float u_length = 0, v_length = 0;        // m
        Texture texture;
        float grain = 1;
        std::vector<Decal> decals;
        int map_u = 0, map_v = 0;
        std::vector<Vec3f> light;  // map_v * map_u, at the map's cell corners
    };
    // 0..5: floor, ceiling, walls x-, x+, y-, y+.
    const Face& shell(int face) const { return faces_[face]; }

  private:
    struct Hit {
        float distance;
        int face;
    };
    void build_shell();
    void build_decals(Vec3f size);
    void build_furniture();
    void build_box(Vec3f base_centre, Vec3f size, float yaw, Texture texture);
    void place_lamps();
    void light_faces();
    Vec3f light_at(Vec3f p, Vec3f normal, std::uint32_t dither) const;
    bool blocked(Vec3f from, Vec3f to) const;
    // Against the shell and the boxes in `boxes` (indices).
    Hit trace(Vec3f origin, Vec3f direction, const std::vector<int>& boxes) const;
    // Boxes that rays from `origin` within the cone about `axis` may hit.
    std::vector<int> boxes_in_cone(Vec3f origin, Vec3f axis, float cosine) const;
    Vec3f shade(const Hit& hit, Vec3f p) const;

    Stage stage_;
    std::uint32_t seed_;
    RoomOptions options_;
    LightOptions light_;
    Vec3f lower_, upper_;  // the room's inside
    std::vector<int> all_boxes_;
    std::vector<Box> boxes_;   // box i has the faces 6 + 5 i ...: +x, -x, +y, -y, top
    std::vector<Face> faces_;  // 0..5: floor, ceiling, walls x-, x+, y-, y+
    Lighting lighting_;
};

}  // namespace kinevox::studio
