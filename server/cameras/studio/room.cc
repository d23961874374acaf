#include "server/cameras/studio/room.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/virtual_camera.h"

namespace kinevox::studio {
namespace {

constexpr int kShellFaces = 6, kFacesPerBox = 5, kTopFace = 4;

// Distance at which a ray enters the box and by which face; infinity if it misses or starts inside.
struct Entry {
    float distance = std::numeric_limits<float>::infinity();
    int face = 0;
};
Entry enter(const Room::Box& box, Vec3f origin, Vec3f direction) {
    const Vec3f o = origin - box.centre;
    const float position[3] = {box.yaw_cos * o.x + box.yaw_sin * o.y, -box.yaw_sin * o.x + box.yaw_cos * o.y,
                               o.z};
    const float way[3] = {box.yaw_cos * direction.x + box.yaw_sin * direction.y,
                          -box.yaw_sin * direction.x + box.yaw_cos * direction.y, direction.z};
    const float half[3] = {box.half.x, box.half.y, box.half.z};
    float near = -std::numeric_limits<float>::infinity(), far = std::numeric_limits<float>::infinity();
    int face = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const float inv = 1.0f / (std::abs(way[axis]) > 1e-9f ? way[axis] : 1e-9f);
        const float t0 = (-std::copysign(half[axis], inv) - position[axis]) * inv;
        const float t1 = (std::copysign(half[axis], inv) - position[axis]) * inv;
        if (t0 > near) {
            near = t0;
            face = axis == 2 ? kTopFace : 2 * axis + (inv > 0 ? 1 : 0);
        }
        far = std::min(far, t1);
    }
    if (near > far || near <= 1e-4f) return {};
    return {near, face};
}

std::uint16_t encode_light(float light) {
    const float shown = std::pow(std::max(light, 0.0f), 1 / 2.2f);
    return static_cast<std::uint16_t>(std::min(shown, 1.0f) * 255.0f * kGreyScale + 0.5f);
}

}  // namespace

std::string LightOptions::check() const {
    const auto outside = [](double v, double low, double high) { return !(v >= low && v <= high); };
    if (outside(key_fraction, 0, 0.95) || outside(panels_fraction, 0, 0.95) ||
        key_fraction + panels_fraction > 0.95)
        return fmt::format("the key lamp and the panels give {} and {} of the light; together at most 0.95",
                           key_fraction, panels_fraction);
    if (key_half_m && outside(*key_half_m, 0.02, 1))
        return fmt::format("the key lamp's half size is {} m; it must be 0.02 .. 1", *key_half_m);
    if (outside(exposure, 0.2, 2)) return fmt::format("exposure is {}; it must be 0.2 .. 2", exposure);
    return {};
}

std::string RoomOptions::check() const {
    for (const double grain : {floor_grain, wall_grain})
        if (!(grain >= 0 && grain <= 2))
            return fmt::format("a grain of floor or walls is {}; it must be 0 .. 2", grain);
    return {};
}

Room::Room(Stage stage, std::uint32_t seed, const RoomOptions& options, const LightOptions& light)
    : stage_(stage), seed_(seed), options_(options), light_(light) {
    build_shell();
    if (options_.furniture) build_furniture();
    place_lamps();
    for (std::size_t b = 0; b < boxes_.size(); ++b) all_boxes_.push_back(static_cast<int>(b));
    light_faces();
}

bool Room::blocked(Vec3f from, Vec3f to) const {
    const Vec3f way = to - from;
    const float distance = norm(way);
    const Vec3f direction = (1.0f / distance) * way;
    for (const Box& box : boxes_) {
        if (box.texture.kind == TextureKind::kLamp) continue;
        const Vec3f o = box.centre - from;  // the ball around the box first
        const float along = std::clamp(dot(o, direction), 0.0f, distance), r2 = dot(box.half, box.half);
        const Vec3f off = o - along * direction;
        if (dot(off, off) > r2) continue;
        if (enter(box, from, direction).distance < distance) return true;
    }
    return false;
}

Vec3f Room::light_at(Vec3f p, Vec3f normal, std::uint32_t dither) const {
    const Vec3f start = p + 0.004f * normal;
    const auto from_lamp = [&](const Lamp& lamp, int across) {
        Vec3f sum;
        for (int i = 0; i < across * across; ++i) {
            Lamp part = lamp;
            part.position.x += lamp.half_size_m *
                               (2 * (static_cast<float>(i % across) + hash_unit(dither, i, 1)) / across - 1);
            part.position.y += lamp.half_size_m *
                               (2 * (static_cast<float>(i / across) + hash_unit(dither, i, 2)) / across - 1);
            const Vec3f light = Lighting::direct(part, p, normal);
            if (light.y > 0 && !blocked(start, part.position)) sum += light;
        }
        return (1.0f / static_cast<float>(across * across)) * sum;
    };
    Vec3f light = from_lamp(lighting_.key, 3);
    for (const Lamp& lamp : lighting_.panels) light += from_lamp(lamp, stage_ == Stage::kLane ? 1 : 2);
    // How much of the surroundings within a metre is open; rays evenly over the hemisphere.
    constexpr int kRays = 16;
    const Vec3f helper = std::abs(normal.x) < 0.8f ? Vec3f{1, 0, 0} : Vec3f{0, 1, 0};
    const Vec3f x = normalized(cross(helper, normal)), y = cross(normal, x);
    float open = 0;
    for (int i = 0; i < kRays; ++i) {
        const float r2 = (static_cast<float>(i) + 0.5f) / kRays, r = std::sqrt(r2),
                    angle = 2.39996f * static_cast<float>(i);
        const Vec3f direction =
            r * std::cos(angle) * x + r * std::sin(angle) * y + std::sqrt(1 - r2) * normal;
        const Hit hit = trace(start, direction, all_boxes_);
        open += std::min(1.0f, 0.25f + 0.75f * hit.distance / 0.8f);
    }
    return light + (open / kRays) * lighting_.ambient(normal);
}

void Room::light_faces() {
    for (std::size_t f = 0; f < faces_.size(); ++f) {
        Face& face = faces_[f];
        const float cell = (f == 0            ? 0.08f
                            : f < kShellFaces ? 0.16f
                                              : 0.12f) *
                           (stage_ == Stage::kLane ? 1.8f : 1.0f);
        face.map_u = std::max(3, static_cast<int>(face.u_length / cell) + 2);
        face.map_v = std::max(3, static_cast<int>(face.v_length / cell) + 2);
        face.light.resize(static_cast<std::size_t>(face.map_u) * face.map_v);
        tbb::parallel_for(0, face.map_v, [&](int j) {
            for (int i = 0; i < face.map_u; ++i) {
                const float u =
                    face.u_length * std::clamp(static_cast<float>(i) / (face.map_u - 1), 0.004f, 0.996f);
                const float v =
                    face.v_length * std::clamp(static_cast<float>(j) / (face.map_v - 1), 0.004f, 0.996f);
                const Vec3f p = face.origin + u * face.along_u + v * face.along_v;
                face.light[static_cast<std::size_t>(j) * face.map_u + i] = light_at(p, face.normal, 7);
            }
        });
    }
}

std::vector<int> Room::boxes_in_cone(Vec3f origin, Vec3f axis, float cosine) const {
    std::vector<int> found;
    const float sine = std::sqrt(std::max(0.0f, 1 - cosine * cosine));
    for (std::size_t b = 0; b < boxes_.size(); ++b) {
        // The ball about the box against the cone: distance of its centre from the cone's side.
        const Vec3f o = boxes_[b].centre - origin;
        const float along = dot(o, axis), across = std::sqrt(std::max(0.0f, dot(o, o) - along * along));
        if (across * cosine - along * sine <= norm(boxes_[b].half)) found.push_back(static_cast<int>(b));
    }
    return found;
}

Room::Hit Room::trace(Vec3f origin, Vec3f direction, const std::vector<int>& boxes) const {
    Hit hit{std::numeric_limits<float>::infinity(), 0};
    const auto plane = [&](float position, float way, float low, float high, int low_face, int high_face) {
        if (std::abs(way) < 1e-9f) return;
        const float distance = ((way > 0 ? high : low) - position) / way;
        if (distance < hit.distance) hit = {distance, way > 0 ? high_face : low_face};
    };
    plane(origin.z, direction.z, lower_.z, upper_.z, 0, 1);
    plane(origin.x, direction.x, lower_.x, upper_.x, 2, 3);
    plane(origin.y, direction.y, lower_.y, upper_.y, 4, 5);
    for (const int b : boxes) {
        const Vec3f o = boxes_[b].centre - origin;
        const float along = dot(o, direction), r2 = dot(boxes_[b].half, boxes_[b].half);
        if (along < 0 && along * along > r2) continue;
        if (dot(o, o) - along * along > r2) continue;
        const Entry entry = enter(boxes_[b], origin, direction);
        if (entry.distance < hit.distance)
            hit = {entry.distance, kShellFaces + kFacesPerBox * b + entry.face};
    }
    return hit;
}

Vec3f Room::shade(const Hit& hit, Vec3f p) const {
    const Face& face = faces_[hit.face];
    const Vec3f local = p - face.origin;
    const float u = std::clamp(dot(local, face.along_u), 0.0f, face.u_length);
    const float v = std::clamp(dot(local, face.along_v), 0.0f, face.v_length);
    Albedo albedo = texture_at(face.texture, u, v, face.u_length, face.v_length);
    if (face.grain != 1) albedo = mix(face.texture.base, albedo, face.grain);
    bool emits = face.texture.kind == TextureKind::kLamp;
    for (const Decal& decal : face.decals)
        if (u >= decal.u0 && u < decal.u1 && v >= decal.v0 && v < decal.v1) {
            albedo = decal_at(decal, u, v);
            emits = emits || decal.kind == DecalKind::kLampPanel;
        }
    if (emits) return {albedo.r, albedo.g, albedo.b};
    const float x = u / face.u_length * (face.map_u - 1), y = v / face.v_length * (face.map_v - 1);
    const int i = std::min(static_cast<int>(x), face.map_u - 2),
              j = std::min(static_cast<int>(y), face.map_v - 2);
    const float fx = x - i, fy = y - j;
    const Vec3f* row = &face.light[static_cast<std::size_t>(j) * face.map_u + i];
    const Vec3f light = (1 - fy) * ((1 - fx) * row[0] + fx * row[1]) +
                        fy * ((1 - fx) * row[face.map_u] + fx * row[face.map_u + 1]);
    return {albedo.r * light.x, albedo.g * light.y, albedo.b * light.z};
}

RoomView Room::draw(const Camera& camera) const {
    RoomView view;
    view.width = camera.width;
    view.height = camera.height;
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
    view.bgr.resize(3 * pixels);
    view.at.resize(2 * pixels);
    view.face.resize(pixels);
    const Lens lens(camera);
    const Vec3f eye = lens.centre_in_world();
    constexpr float kOffsets[4][2] = {
        {-0.375f, -0.125f}, {0.125f, -0.375f}, {0.375f, 0.125f}, {-0.125f, 0.375f}};
    const auto draw_pixel = [&](int column, int row, const std::vector<int>& boxes) {
        const std::size_t pixel = static_cast<std::size_t>(row) * camera.width + column;
        float shown[3] = {};
        for (const auto& offset : kOffsets) {
            const Vec3f direction = lens.direction_through(column + offset[0], row + offset[1]);
            const Hit hit = trace(eye, direction, boxes);
            const Vec3f light = shade(hit, eye + hit.distance * direction);
            shown[0] += encode_light(light.z);
            shown[1] += encode_light(light.y);
            shown[2] += encode_light(light.x);
        }
        for (int c = 0; c < 3; ++c) view.bgr[3 * pixel + c] = static_cast<std::uint16_t>(0.25f * shown[c]);
        const Vec3f direction = lens.direction_through(static_cast<float>(column), static_cast<float>(row));
        const Hit hit = trace(eye, direction, boxes);
        const Vec3f p = eye + hit.distance * direction;
        const bool shell = hit.face == 0 || (hit.face > 1 && hit.face < kShellFaces);
        view.face[pixel] = shell ? static_cast<std::uint8_t>(hit.face) : RoomView::kNoFace;
        float* at = &view.at[2 * pixel];
        const Face& face_seen = faces_[hit.face];
        at[0] = at[1] = std::numeric_limits<float>::quiet_NaN();
        if (hit.face == 0) at[0] = p.x, at[1] = p.y;
        if (shell && hit.face != 0)
            at[0] = dot(p - face_seen.origin, face_seen.along_u),
            at[1] = dot(p - face_seen.origin, face_seen.along_v);
    };
    constexpr int kTile = 16;
    tbb::parallel_for(0, (camera.height + kTile - 1) / kTile, [&](int tile_row) {
        const int y0 = tile_row * kTile, y1 = std::min(y0 + kTile, camera.height);
        for (int x0 = 0; x0 < camera.width; x0 += kTile) {
            const int x1 = std::min(x0 + kTile, camera.width);
            const Vec3f axis = lens.direction_through(0.5f * static_cast<float>(x0 + x1),
                                                      0.5f * static_cast<float>(y0 + y1));
            float cosine = 1;  // of the cone that holds the tile and two pixels around it
            for (int x : {x0 - 2, x1 + 2})
                for (int y : {y0 - 2, y1 + 2})
                    cosine = std::min(cosine, dot(axis, lens.direction_through(static_cast<float>(x),
                                                                               static_cast<float>(y))));
            const std::vector<int> boxes = boxes_in_cone(eye, axis, cosine);
            for (int y = y0; y < y1; ++y)
                for (int x = x0; x < x1; ++x) draw_pixel(x, y, boxes);
        }
    });
    return view;
}

}  // namespace kinevox::studio
