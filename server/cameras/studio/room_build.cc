// Furniture and lamps of the studio.
#include <cmath>

#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/room.h"

namespace kinevox::studio {
namespace {

constexpr Albedo kLinePaint{0.66f, 0.65f, 0.62f};

Albedo pick(std::initializer_list<Albedo> from, std::uint32_t seed) {
    return from.begin()[hash_u32(seed) % from.size()];
}

}  // namespace

void Room::build_shell() {
    const bool hall = stage_ == Stage::kLane;
    if (hall) {
        lower_ = {-5.5f, -9.0f, 0};
        upper_ = {17.5f, 9.0f, 6.0f};
    } else {
        lower_ = {-5.2f, -5.0f, 0};
        upper_ = {5.2f, 5.0f, 3.9f};
    }
    const Vec3f size = upper_ - lower_;
    const auto face = [&](Vec3f origin, Vec3f u, Vec3f v, Vec3f normal, float lu, float lv, Texture texture) {
        faces_.push_back({.origin = origin,
                          .along_u = u,
                          .along_v = v,
                          .normal = normal,
                          .u_length = lu,
                          .v_length = lv,
                          .texture = texture});
    };
    const Albedo wall_a =
        pick({{0.55f, 0.53f, 0.47f}, {0.42f, 0.47f, 0.52f}, {0.38f, 0.48f, 0.42f}, {0.56f, 0.50f, 0.42f}},
             seed_ + 1);
    const Albedo wall_b =
        pick({{0.50f, 0.50f, 0.49f}, {0.56f, 0.54f, 0.46f}, {0.42f, 0.43f, 0.48f}}, seed_ + 2);
    const Albedo bricks =
        pick({{0.30f, 0.12f, 0.075f}, {0.34f, 0.26f, 0.19f}, {0.26f, 0.10f, 0.08f}}, seed_ + 3);
    const Albedo panels =
        pick({{0.12f, 0.16f, 0.24f}, {0.10f, 0.19f, 0.15f}, {0.20f, 0.13f, 0.08f}}, seed_ + 4);
    const bool wooden = hash_u32(seed_, 5) % 3 != 0;
    const Texture floor = hall     ? Texture{TextureKind::kTrack, {0.33f, 0.085f, 0.055f}, seed_}
                          : wooden ? Texture{TextureKind::kWoodFloor, {0.34f, 0.21f, 0.115f}, seed_}
                                   : Texture{TextureKind::kConcrete, {0.27f, 0.265f, 0.25f}, seed_};
    face(lower_, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, size.x, size.y, floor);
    face({lower_.x, lower_.y, upper_.z}, {1, 0, 0}, {0, 1, 0}, {0, 0, -1}, size.x, size.y,
         {TextureKind::kCeiling, {0.62f, 0.62f, 0.60f}, seed_ + 6});
    face(lower_, {0, 1, 0}, {0, 0, 1}, {1, 0, 0}, size.y, size.z, {TextureKind::kPaint, wall_a, seed_ + 7});
    face({upper_.x, lower_.y, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, size.y, size.z,
         {TextureKind::kBrick, bricks, seed_ + 8});
    face(lower_, {1, 0, 0}, {0, 0, 1}, {0, 1, 0}, size.x, size.z,
         {TextureKind::kPanelling, panels, seed_ + 9});
    face({lower_.x, upper_.y, 0}, {1, 0, 0}, {0, 0, 1}, {0, -1, 0}, size.x, size.z,
         {TextureKind::kPaint, wall_b, seed_ + 10});

    for (int f : {0, 2, 3, 4, 5}) {
        Face& shell = faces_[f];
        const bool floor = f == 0;
        if (const auto kind = floor ? options_.floor : options_.walls) shell.texture.kind = *kind;
        if (const auto colour = floor ? options_.floor_colour : options_.wall_colour)
            shell.texture.base = *colour;
        shell.grain = static_cast<float>(floor ? options_.floor_grain : options_.wall_grain);
    }
    if (options_.decals) build_decals(size);
}

void Room::build_decals(Vec3f size) {
    const bool hall = stage_ == Stage::kLane;
    if (hall) {  // u, v of the floor: world x, y less the corner
        for (float y : {-5.0f, -3.0f, -1.0f, 1.0f, 3.0f, 5.0f})
            faces_[0].decals.push_back({DecalKind::kLaneLine, 1.5f, y - lower_.y - 0.025f, size.x - 1.5f,
                                        y - lower_.y + 0.025f, kLinePaint, seed_});
        for (float x : {0.0f, 12.0f})
            faces_[0].decals.push_back({DecalKind::kLaneLine, x - lower_.x - 0.03f, 4.0f,
                                        x - lower_.x + 0.03f, 14.0f, kLinePaint, seed_ + 1});
    } else {
        faces_[0].decals.push_back({DecalKind::kTape, 2.2f, 3.1f, 2.24f, 4.6f, {0.60f, 0.45f, 0.03f}, seed_});
        faces_[0].decals.push_back({DecalKind::kTape, 6.9f, 6.0f, 8.3f, 6.04f, kLinePaint, seed_ + 1});
        faces_[0].decals.push_back(
            {DecalKind::kTape, 4.1f, 7.7f, 4.7f, 7.76f, {0.05f, 0.10f, 0.40f}, seed_ + 2});
    }
    std::uint32_t number = 0;
    for (int wall = 2; wall < 6; ++wall) {
        const float length = faces_[wall].u_length;
        if (wall != 4)
            faces_[wall].decals.push_back(
                {DecalKind::kDoor, 0.5f, 0.0f, 1.45f, 2.1f, {0.24f, 0.14f, 0.07f}, seed_ + 30});
        for (float u = 2.2f + hash_unit(seed_, wall); u + 1.4f < length;
             u += 2.1f + 1.5f * hash_unit(seed_, number, 11)) {
            ++number;
            const bool board = hash_u32(seed_, number, 12) % 3 == 0;
            const float wide = board ? 1.4f : 0.62f, high = board ? 0.9f : 0.86f, v = board ? 1.15f : 1.35f;
            faces_[wall].decals.push_back(
                {board ? DecalKind::kWhiteboard : DecalKind::kPoster, u, v, u + wide, v + high,
                 pick(
                     {{0.5f, 0.35f, 0.4f}, {0.25f, 0.45f, 0.15f}, {0.5f, 0.45f, 0.3f}, {0.15f, 0.25f, 0.45f}},
                     seed_ + number),
                 seed_ + number});
        }
    }
}

void Room::build_box(Vec3f base, Vec3f size, float yaw, Texture texture) {
    Box box{{base.x, base.y, base.z + 0.5f * size.z}, 0.5f * size, std::cos(yaw), std::sin(yaw), texture};
    const auto turned = [&](Vec3f v) {
        return Vec3f{box.yaw_cos * v.x - box.yaw_sin * v.y, box.yaw_sin * v.x + box.yaw_cos * v.y, v.z};
    };
    const Vec3f h = box.half, up{0, 0, 1};
    const auto face = [&](Vec3f corner, Vec3f u, Vec3f v, Vec3f normal, float lu, float lv) {
        faces_.push_back({.origin = box.centre + turned(corner),
                          .along_u = turned(u),
                          .along_v = turned(v),
                          .normal = turned(normal),
                          .u_length = lu,
                          .v_length = lv,
                          .texture = texture});
    };
    face({h.x, -h.y, -h.z}, {0, 1, 0}, up, {1, 0, 0}, size.y, size.z);
    face({-h.x, -h.y, -h.z}, {0, 1, 0}, up, {-1, 0, 0}, size.y, size.z);
    face({-h.x, h.y, -h.z}, {1, 0, 0}, up, {0, 1, 0}, size.x, size.z);
    face({-h.x, -h.y, -h.z}, {1, 0, 0}, up, {0, -1, 0}, size.x, size.z);
    face({-h.x, -h.y, h.z}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, size.x, size.y);
    if (texture.kind == TextureKind::kShelf || texture.kind == TextureKind::kCabinet ||
        texture.kind == TextureKind::kScreen)
        faces_.back().texture.kind = TextureKind::kWood, faces_.back().texture.base = {0.10f, 0.06f, 0.035f};
    boxes_.push_back(box);
}

void Room::build_furniture() {
    // Furniture along each wall, outside the ring of cameras.
    std::uint32_t number = 100;
    for (int wall = 2; wall < 6; ++wall) {
        const Face shell = faces_[wall];
        const float yaw = std::atan2(shell.normal.y, shell.normal.x);
        float u = 1.7f + 0.5f * hash_unit(seed_, wall, 20);
        while (u + 1.6f < shell.u_length) {
            ++number;
            const auto put = [&](float from_wall, float shift, float base, Vec3f size, Texture t) {
                const Vec3f at = shell.origin + (u + shift) * shell.along_u + from_wall * shell.normal;
                build_box({at.x, at.y, base}, size, yaw, t);
            };
            const std::uint32_t what = hash_u32(seed_, number, 21) % 5;
            switch (what) {
                case 0:
                    put(0.17f, 0.45f, 0, {0.30f, 0.9f, 1.75f}, {TextureKind::kShelf, {}, number});
                    break;
                case 1:
                    put(0.24f, 0.45f, 0, {0.44f, 0.9f, 0.98f},
                        {TextureKind::kCabinet,
                         pick({{0.30f, 0.32f, 0.35f}, {0.12f, 0.20f, 0.34f}, {0.36f, 0.22f, 0.10f}}, number),
                         number});
                    break;
                case 2:
                    put(0.33f, 0.65f, 0.72f, {0.62f, 1.3f, 0.035f},
                        {TextureKind::kWood, {0.36f, 0.22f, 0.12f}, number});
                    for (float x : {0.07f, 0.59f})
                        for (float y : {0.05f, 1.25f})
                            put(x, y, 0, {0.05f, 0.05f, 0.72f},
                                {TextureKind::kPaint, {0.05f, 0.05f, 0.05f}, number});
                    put(0.22f, 0.6f, 0.755f, {0.05f, 0.52f, 0.34f}, {TextureKind::kScreen, {}, number});
                    break;
                case 3:
                    put(0.25f, 0.3f, 0, {0.42f, 0.5f, 0.38f},
                        {TextureKind::kCrate, {0.38f, 0.26f, 0.15f}, number});
                    put(0.24f, 0.28f, 0.38f, {0.36f, 0.4f, 0.30f},
                        {TextureKind::kCrate, pick({{0.42f, 0.08f, 0.05f}, {0.10f, 0.16f, 0.36f}}, number),
                         number + 1});
                    break;
                default:
                    put(0.30f, 0.35f, 0.42f, {0.44f, 0.44f, 0.06f},
                        {TextureKind::kMat, pick({{0.06f, 0.12f, 0.32f}, {0.35f, 0.05f, 0.04f}}, number),
                         number});
                    put(0.10f, 0.35f, 0.48f, {0.05f, 0.42f, 0.42f},
                        {TextureKind::kMat, {0.06f, 0.12f, 0.32f}, number});
                    for (float x : {0.11f, 0.49f})
                        for (float y : {0.16f, 0.54f})
                            put(x, y, 0, {0.03f, 0.03f, 0.42f},
                                {TextureKind::kPaint, {0.04f, 0.04f, 0.04f}, number});
            }
            u += (what == 2 ? 1.5f : 1.1f) +
                 (stage_ == Stage::kLane ? 2.6f : 0.9f) * hash_unit(seed_, number, 22);
        }
    }
}

void Room::place_lamps() {
    const bool hall = stage_ == Stage::kLane;
    const float ceiling = upper_.z - 0.03f;
    const Vec3f warm{1.0f, 0.95f, 0.86f}, cool{0.94f, 0.98f, 1.0f};
    const Vec3f middle = hall ? Vec3f{6, 0, 0} : Vec3f{0, 0, 0}, up{0, 0, 1};
    const float side = hash_u32(seed_, 31) % 2 ? 1.0f : -1.0f;
    lighting_.key = hall ? Lamp{{6.0f + 2.0f * side, -3.6f * side, 5.8f}, warm, 0.30f, true}
                         : Lamp{{-1.3f * side, 1.7f, 3.75f}, warm, 0.14f, true};
    const std::vector<Vec3f> positions =
        hall ? std::vector<Vec3f>{{0, 2, ceiling},  {6, 2, ceiling},  {12, 2, ceiling},
                                  {0, -4, ceiling}, {6, -4, ceiling}, {12, -4, ceiling}}
             : std::vector<Vec3f>{{-2.2f, -1.8f, ceiling}, {2.2f, -1.8f, ceiling}, {2.2f, 2.0f, ceiling}};
    for (const Vec3f& position : positions)
        lighting_.panels.push_back({position, cool, hall ? 0.9f : 0.5f, true});
    if (light_.key_position) {
        lighting_.key.position = to_float(*light_.key_position);
        lighting_.key.downlight = lighting_.key.position.z > 0.75f * upper_.z;  // lower: a lamp on a stand
    }
    if (light_.key_half_m) lighting_.key.half_size_m = static_cast<float>(*light_.key_half_m);
    const float bright = static_cast<float>(light_.exposure);
    const float of_key = static_cast<float>(light_.key_fraction) * bright;
    const float of_panels = static_cast<float>(light_.panels_fraction) * bright;
    const float reflected = static_cast<float>(1 - light_.key_fraction - light_.panels_fraction) * bright;
    const Vec3f key_colour =
        light_.tint ? Vec3f{light_.tint->r, light_.tint->g, light_.tint->b} : Vec3f{1.0f, 0.95f, 0.86f};
    const auto normalise = [&](float share, float now) { return share / now; };
    lighting_.key.power = normalise(of_key, Lighting::direct(lighting_.key, middle, up).y) * key_colour;
    float panels = 0;
    for (const Lamp& lamp : lighting_.panels) panels += Lighting::direct(lamp, middle, up).y;
    for (Lamp& lamp : lighting_.panels) lamp.power = normalise(of_panels, panels) * cool;
    lighting_.from_above = reflected * Vec3f{1.0f, 0.99f, 0.96f};
    const Albedo floor = faces_[0].texture.base;
    lighting_.from_below = 1.5f * reflected * Vec3f{0.40f + floor.r, 0.40f + floor.g, 0.40f + floor.b};
    for (const Lamp& lamp : lighting_.panels) {
        const Vec3f at = lamp.position - lower_;
        Face& above = faces_[1];
        above.decals.push_back({DecalKind::kLampPanel,
                                at.x - lamp.half_size_m,
                                at.y - 0.4f * lamp.half_size_m,
                                at.x + lamp.half_size_m,
                                at.y + 0.4f * lamp.half_size_m,
                                {},
                                0});
    }
    const Vec3f key = lighting_.key.position;
    const float high = lighting_.key.downlight ? upper_.z - key.z - 0.01f : 0.15f;
    build_box({key.x, key.y, key.z + 0.01f},
              {2 * lighting_.key.half_size_m, 2 * lighting_.key.half_size_m, high}, 0.0f,
              {TextureKind::kLamp, {}, 0});
}

}  // namespace kinevox::studio
