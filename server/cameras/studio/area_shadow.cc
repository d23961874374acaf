#include "server/cameras/studio/area_shadow.h"

#include <algorithm>
#include <cmath>

#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

constexpr int kKeyAcross = 5, kPanelAcross = 3, kDirections = 40;
constexpr float kFloorCell_m = 0.03f, kWallCell_m = 0.05f, kFarAlong = 0.93f;

std::vector<Vec3f> points_of(const Lamp& lamp, int across) {
    std::vector<Vec3f> points;
    for (int i = 0; i < across * across; ++i) {
        const auto n = static_cast<std::uint32_t>(i);
        const float u =
            2 * (static_cast<float>(i % across) + hash_unit(n, 51)) / static_cast<float>(across) - 1;
        const float v =
            2 * (static_cast<float>(i / across) + hash_unit(n, 52)) / static_cast<float>(across) - 1;
        points.push_back(lamp.position + lamp.half_size_m * Vec3f{u, v, 0});
    }
    return points;
}

// Evenly over the light that a face receives from all sides: more along its normal (+z).
std::vector<Vec3f> directions() {
    std::vector<Vec3f> out;
    for (int i = 0; i < kDirections; ++i) {
        const float r2 = (static_cast<float>(i) + 0.5f) / kDirections, r = std::sqrt(r2);
        const float angle = 2.39996f * static_cast<float>(i);
        out.push_back({r * std::cos(angle), r * std::sin(angle), std::sqrt(1 - r2)});
    }
    return out;
}

}  // namespace

AreaShadow::AreaShadow(const Room& room) : room_(room) {
    const Lighting& lighting = room.lighting();
    lights_.push_back({&lighting.key, points_of(lighting.key, kKeyAcross)});
    for (const Lamp& lamp : lighting.panels) lights_.push_back({&lamp, points_of(lamp, kPanelAcross)});
    lights_.push_back({nullptr, directions()});
    for (int f : {0, 2, 3, 4, 5}) {
        Plane& plane = planes_[f];
        const Room::Face& face = room.shell(f);
        plane.cell_m = f == 0 ? kFloorCell_m : kWallCell_m;
        plane.wide = static_cast<int>(face.u_length / plane.cell_m) + 2;
        plane.high = static_cast<int>(face.v_length / plane.cell_m) + 2;
        const std::size_t cells = static_cast<std::size_t>(plane.wide) * plane.high;
        plane.hidden.assign(lights_.size(), std::vector<std::uint8_t>(cells, 0));
        plane.mark.assign(cells, 0);
        plane.factor.assign(cells, {1, 1, 1});
    }
}

// Where the light from `lamp` (or from `direction`, of the light) through each vertex meets the face.
void AreaShadow::project(int f, const Vec3f* lamp, Vec3f direction, float cell_m) {
    const Room::Face& face = room_.shell(f);
    const float inv = 1 / cell_m;
    const float lamp_height = lamp ? dot(*lamp - face.origin, face.normal) : 0;
    const std::vector<Vec3f>& vertices = *vertices_;
    seen_.resize(vertices.size());
    for (std::size_t i = 0; i < vertices.size(); ++i) {
        const Vec3f p = vertices[i];
        const float height = std::max(dot(p - face.origin, face.normal), 0.0f);
        Vec3f at;
        if (lamp) {
            if (height > kFarAlong * lamp_height) {
                seen_[i].z = 0;
                continue;
            }
            at = *lamp + (lamp_height / (lamp_height - height)) * (p - *lamp) - face.origin;
        } else {
            at = p - (height / dot(direction, face.normal)) * direction - face.origin;
        }
        seen_[i] = {dot(at, face.along_u) * inv, dot(at, face.along_v) * inv, 1};
    }
}

void AreaShadow::add_point(Plane& plane, int f, std::size_t light, const Vec3f* lamp, Vec3f direction,
                           std::uint16_t number, const TriangleMesh& surface) {
    project(f, lamp, direction, plane.cell_m);
    float x0 = 1e9f, y0 = 1e9f, x1 = -1e9f, y1 = -1e9f;
    for (const Vec3f& s : seen_)
        if (s.z > 0)
            x0 = std::min(x0, s.x), x1 = std::max(x1, s.x), y0 = std::min(y0, s.y), y1 = std::max(y1, s.y);
    const auto inside = [](float v, int size) {
        return static_cast<int>(std::clamp(v, 0.0f, static_cast<float>(size)));
    };
    const CellBounds box{inside(x0 - 1, plane.wide), inside(y0 - 1, plane.high), inside(x1 + 2, plane.wide),
                         inside(y1 + 2, plane.high)};
    if (x0 > x1 || box.empty()) return;
    plane.dark = {std::min(plane.dark.x0, box.x0), std::min(plane.dark.y0, box.y0),
                  std::max(plane.dark.x1, box.x1), std::max(plane.dark.y1, box.y1)};
    std::vector<std::uint8_t>& hidden = plane.hidden[light];
    for (const auto& t : surface.triangles) {
        const Vec3f a = seen_[t[0]], b = seen_[t[1]], c = seen_[t[2]];
        if (!(a.z > 0 && b.z > 0 && c.z > 0)) continue;
        // A closed surface: the side towards the face is enough.
        if ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x) > 0) continue;
        for_cells_in_triangle(a.x, a.y, b.x, b.y, c.x, c.y, box, [&](int x, int y, float, float) {
            const std::size_t i = static_cast<std::size_t>(y) * plane.wide + x;
            hidden[i] = static_cast<std::uint8_t>(hidden[i] + (plane.mark[i] != number));
            plane.mark[i] = number;
        });
    }
}

void AreaShadow::cast(const TriangleMesh& surface, const std::vector<Vec3f>& vertices) {
    vertices_ = &vertices;
    for (int f : {0, 2, 3, 4, 5}) {
        Plane& plane = planes_[f];
        for (int y = plane.dark.y0; y < plane.dark.y1; ++y) {
            const std::size_t row = static_cast<std::size_t>(y) * plane.wide;
            for (std::vector<std::uint8_t>& hidden : plane.hidden)
                std::fill_n(&hidden[row + plane.dark.x0], plane.dark.x1 - plane.dark.x0, std::uint8_t{0});
            std::fill_n(&plane.mark[row + plane.dark.x0], plane.dark.x1 - plane.dark.x0, std::uint16_t{0});
        }
        plane.dark = {plane.wide, plane.high, 0, 0};
        std::uint16_t number = 0;
        const Room::Face& face = room_.shell(f);
        for (std::size_t l = 0; l < lights_.size(); ++l)
            for (const Vec3f& point : lights_[l].points) {
                ++number;
                if (lights_[l].lamp)
                    add_point(plane, f, l, &point, {}, number, surface);
                else if (f == 0 && point.z > 0.35f)  // of walls, the person is too far away
                    add_point(plane, f, l, nullptr,
                              point.x * face.along_u + point.y * face.along_v + point.z * face.normal, number,
                              surface);
            }
        finish(plane, f);
    }
}

// The mean of 3 x 3 cells, so that the points of a light do not show one by one.
void AreaShadow::smooth(Plane& plane, std::size_t light) const {
    const CellBounds& d = plane.dark;
    std::vector<std::uint8_t>& hidden = plane.hidden[light];
    scratch_.assign(static_cast<std::size_t>(plane.wide) * plane.high, 0);
    const auto at = [&](int x, int y) { return static_cast<std::size_t>(y) * plane.wide + x; };
    for (int y = d.y0; y < d.y1; ++y)
        for (int x = std::max(d.x0, 1); x < std::min(d.x1, plane.wide - 1); ++x)
            scratch_[at(x, y)] = static_cast<std::uint16_t>(hidden[at(x - 1, y)] + 2 * hidden[at(x, y)] +
                                                            hidden[at(x + 1, y)]);
    for (int y = std::max(d.y0, 1); y < std::min(d.y1, plane.high - 1); ++y)
        for (int x = d.x0; x < d.x1; ++x)
            hidden[at(x, y)] = static_cast<std::uint8_t>(
                (scratch_[at(x, y - 1)] + 2 * scratch_[at(x, y)] + scratch_[at(x, y + 1)]) / 4);
}

void AreaShadow::finish(Plane& plane, int f) {
    CellBounds& d = plane.dark;
    if (d.empty()) return;
    // A rim of ones, so that interpolation ends smoothly.
    d = {std::max(0, d.x0 - 2), std::max(0, d.y0 - 2), std::min(plane.wide, d.x1 + 2),
         std::min(plane.high, d.y1 + 2)};
    // smooth() multiplies by 4 so that the rounding is finer than a point.
    for (std::size_t l = 0; l < lights_.size(); ++l)
        if (4 * lights_[l].points.size() < 256) smooth(plane, l);
    const Room::Face& face = room_.shell(f);
    const Vec3f ambient = room_.lighting().ambient(face.normal);
    for (int y = d.y0; y < d.y1; ++y)
        for (int x = d.x0; x < d.x1; ++x) {
            const std::size_t i = static_cast<std::size_t>(y) * plane.wide + x;
            Vec3f& factor = plane.factor[i];
            factor = {1, 1, 1};
            int points = 0;
            for (const auto& hidden : plane.hidden) points += hidden[i];
            if (points == 0) continue;
            const Vec3f p = face.origin + (static_cast<float>(x) * plane.cell_m) * face.along_u +
                            (static_cast<float>(y) * plane.cell_m) * face.along_v;
            Vec3f all, seen;
            for (std::size_t l = 0; l < lights_.size(); ++l) {
                const Vec3f light =
                    lights_[l].lamp ? Lighting::direct(*lights_[l].lamp, p, face.normal) : ambient;
                const float scale = 4 * lights_[l].points.size() < 256 ? 4.0f : 1.0f;
                const float share = static_cast<float>(plane.hidden[l][i]) /
                                    (scale * static_cast<float>(lights_[l].points.size()));
                all += light;
                seen += std::max(0.0f, 1 - share) * light;
            }
            const auto shown = [](float now, float before) {
                return before > 1e-6f ? std::pow(std::min(now / before, 1.0f), 1 / 2.2f) : 1.0f;
            };
            factor = {shown(seen.x, all.x), shown(seen.y, all.y), shown(seen.z, all.z)};
        }
}

void AreaShadow::darken(const RoomView& view, std::size_t first, int count, std::uint16_t* bgr) const {
    const Vec3f corner = room_.shell(0).origin;
    for (int n = 0; n < count; ++n) {
        const std::size_t pixel = first + static_cast<std::size_t>(n);
        const std::uint8_t f = view.face[pixel];
        if (f == RoomView::kNoFace) continue;
        const Plane& plane = planes_[f];
        float u = view.at[2 * pixel], v = view.at[2 * pixel + 1];
        if (f == 0) u -= corner.x, v -= corner.y;
        u /= plane.cell_m, v /= plane.cell_m;
        if (!(u >= static_cast<float>(plane.dark.x0) && v >= static_cast<float>(plane.dark.y0) &&
              u < static_cast<float>(plane.dark.x1 - 1) && v < static_cast<float>(plane.dark.y1 - 1)))
            continue;
        const int i = static_cast<int>(u), j = static_cast<int>(v);
        const float fu = u - static_cast<float>(i), fv = v - static_cast<float>(j);
        const Vec3f* row = &plane.factor[static_cast<std::size_t>(j) * plane.wide + i];
        const Vec3f factor = (1 - fv) * ((1 - fu) * row[0] + fu * row[1]) +
                             fv * ((1 - fu) * row[plane.wide] + fu * row[plane.wide + 1]);
        bgr[3 * n] = static_cast<std::uint16_t>(factor.z * static_cast<float>(bgr[3 * n]));
        bgr[3 * n + 1] = static_cast<std::uint16_t>(factor.y * static_cast<float>(bgr[3 * n + 1]));
        bgr[3 * n + 2] = static_cast<std::uint16_t>(factor.x * static_cast<float>(bgr[3 * n + 2]));
    }
}

}  // namespace kinevox::studio
