// The contour of a tapered capsule in a pinhole camera consists of two arcs and two straight lines: the
// projection of the convex hull of two balls is the convex hull of their projections. Each arc belongs to a
// ball's tangent circle, each line to a plane through the camera's centre that is tangent to both balls. The
// arcs are approximated by polygons, the corners are distorted, and each row is filled between its leftmost
// and rightmost point.
#include "kernels/cpu/body_silhouette.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

#include "kernels/shared/body_silhouette.h"

namespace kinevox::kernels {
namespace {

struct Vector {
    float x, y, z;
};
Vector operator+(Vector a, Vector b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
Vector operator-(Vector a, Vector b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
Vector operator*(float s, Vector a) {
    return {s * a.x, s * a.y, s * a.z};
}
float dot(Vector a, Vector b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
Vector cross(Vector a, Vector b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

constexpr float kPi = 3.14159265358979f;
constexpr int kMaxArcPieces = 96;
constexpr int kLinePieces = 12;  // segments of a straight line, which distortion bends

class OutlineFiller {
  public:
    OutlineFiller(const Projector& camera, std::uint8_t* mask) : camera_(camera), mask_(mask) {
        bounds_ = {camera.width, camera.height, 0, 0};
    }

    void draw(const CameraCapsule& capsule) {
        count_ = 0;
        const Vector a{capsule.a.x, capsule.a.y, capsule.a.z}, b{capsule.b.x, capsule.b.y, capsule.b.z};
        outline(a, capsule.radius_a, b, capsule.radius_b);
        fill();
    }

    Rect bounds() const { return bounds_.x1 > bounds_.x0 ? bounds_ : Rect{}; }

  private:
    void corner(Vector p) {
        const float w = 1 / p.z;
        float x = p.x * w, y = p.y * w;
        if (camera_.distorted) {
            const float r2 = x * x + y * y;
            if (r2 > camera_.max_radius2) {  // outside the domain of the distortion model
                const float shrink = std::sqrt(camera_.max_radius2 / r2);
                x *= shrink, y *= shrink;
            }
            distort(camera_, x, y);
        }
        u_[count_] = std::clamp(camera_.fx * x + camera_.cx, -30000.f, 30000.f);
        v_[count_] = std::clamp(camera_.fy * y + camera_.cy, -30000.f, 30000.f);
        ++count_;
    }

    // Corners of the tangent circle of a ball between the angles -half and half from `outwards`, which is
    // perpendicular to the centre's direction and has length 1; in order of the angle.
    void arc(Vector centre, float radius, Vector outwards, float half) {
        const float d2 = dot(centre, centre), share = radius * radius / d2;
        const Vector middle = (1 - share) * centre;
        const float rho = radius * std::sqrt(1 - share);
        const Vector e1 = rho * outwards;
        const Vector e2 = (rho / std::sqrt(d2)) * cross(centre, outwards);
        const float radius_px = std::max(camera_.fx, camera_.fy) * radius / centre.z;
        const float pieces_wanted = half * std::sqrt(std::max(radius_px, 0.1f) / 0.4f);
        const int pieces = std::clamp(static_cast<int>(pieces_wanted) + 2, 2, kMaxArcPieces);
        const float step = 2 * half / static_cast<float>(pieces);
        // Corners a little outside, so that the polygon has the arc's area; the ends belong to the straight
        // lines.
        const float beyond = 1 + step * step / 12;
        const float turn_c = std::cos(step), turn_s = std::sin(step);
        float c = std::cos(half), s = -std::sin(half);
        for (int n = 0; n <= pieces; ++n) {
            const float scale = n == 0 || n == pieces ? 1 : beyond;
            corner(middle + (scale * c) * e1 + (scale * s) * e2);
            const float next = c * turn_c - s * turn_s;
            s = s * turn_c + c * turn_s;
            c = next;
        }
    }

    void line(Vector from, Vector to) {
        if (!camera_.distorted) return;  // the next corner ends it
        for (int n = 1; n < kLinePieces; ++n) {
            const float t = static_cast<float>(n) / kLinePieces;
            corner(from + t * (to - from));
        }
    }

    void whole(Vector centre, float radius) {
        const Vector sideways = std::fabs(centre.x) < std::fabs(centre.y) ? Vector{1, 0, 0} : Vector{0, 1, 0};
        Vector outwards = cross(centre, sideways);
        outwards = (1 / std::sqrt(dot(outwards, outwards))) * outwards;
        arc(centre, radius, outwards, kPi);
    }

    void outline(Vector a, float ra, Vector b, float rb) {
        // A plane n . x = 0 touches both balls from outside where n . a = ra and n . b = rb; n = in + across,
        // with `in` in the plane of a and b.
        const Vector normal = cross(a, b);
        const float aa = dot(a, a), bb = dot(b, b), ab = dot(a, b), determinant = dot(normal, normal);
        const float scale_a = ra * bb - rb * ab, scale_b = rb * aa - ra * ab;
        const float in2 = (ra * scale_a + rb * scale_b);  // |in|^2 * determinant
        if (!(in2 < 0.9999f * determinant)) {             // one ball hides the other
            const bool first = ra * ra * bb > rb * rb * aa;
            whole(first ? a : b, first ? ra : rb);
            return;
        }
        const float length = std::sqrt(determinant);
        const Vector unit = (1 / length) * normal;
        const Vector in = (1 / determinant) * (scale_a * a + scale_b * b);
        const float across = std::sqrt(std::max(0.f, 1 - in2 / determinant));
        // Away from the other ball, perpendicular to the centre's direction.
        const Vector away_a = (1 / std::sqrt(aa)) * cross(a, unit),
                     away_b = (1 / std::sqrt(bb)) * cross(unit, b);
        const auto half_angle = [&](Vector away, float centre2, float radius) {
            const float rho = std::sqrt(1 - radius * radius / centre2);
            return std::acos(std::clamp(-dot(in, away) / rho, -1.f, 1.f));
        };
        const float half_a = half_angle(away_a, aa, ra), half_b = half_angle(away_b, bb, rb);
        const Vector n1 = in + across * unit, n2 = in - across * unit;
        // cross(centre, away) points to -unit for a and to unit for b: a's arc ends on that side, where n1
        // touches, and b's begins there.
        arc(a, ra, away_a, half_a);
        line(a - ra * n1, b - rb * n1);
        arc(b, rb, away_b, half_b);
        line(b - rb * n2, a - ra * n2);
    }

    void fill() {
        float top = v_[0], bottom = v_[0];
        for (int n = 1; n < count_; ++n) top = std::min(top, v_[n]), bottom = std::max(bottom, v_[n]);
        const int first = std::max(static_cast<int>(std::ceil(top)), 0);
        const int last = std::min(static_cast<int>(std::floor(bottom)), camera_.height - 1);
        if (first > last) return;
        if (static_cast<int>(left_.size()) < camera_.height)
            left_.resize(camera_.height), right_.resize(camera_.height);
        for (int y = first; y <= last; ++y) left_[y] = 1e9f, right_[y] = -1e9f;
        for (int n = 0; n < count_; ++n) {
            const int m = n + 1 == count_ ? 0 : n + 1;
            edge(u_[n], v_[n], u_[m], v_[m], first, last);
        }
        int filled_left = bounds_.x0, filled_right = bounds_.x1, filled_top = bounds_.y0,
            filled_bottom = bounds_.y1;
        for (int y = first; y <= last; ++y) {
            const int x0 = static_cast<int>(std::ceil(std::max(left_[y], 0.f)));
            const int x1 =
                static_cast<int>(std::floor(std::min(right_[y], static_cast<float>(camera_.width - 1)))) + 1;
            if (x0 >= x1) continue;
            std::memset(mask_ + static_cast<std::size_t>(y) * camera_.width + x0, 255, x1 - x0);
            filled_left = std::min(filled_left, x0), filled_right = std::max(filled_right, x1);
            filled_top = std::min(filled_top, y), filled_bottom = std::max(filled_bottom, y + 1);
        }
        bounds_ = {filled_left, filled_top, filled_right, filled_bottom};
    }

    void edge(float u0, float v0, float u1, float v1, int first, int last) {
        if (v0 > v1) std::swap(u0, u1), std::swap(v0, v1);
        const int from = std::max(static_cast<int>(std::ceil(v0)), first);
        const int to = std::min(static_cast<int>(std::floor(v1)), last);
        if (from > to) return;
        const float slope = v1 > v0 ? (u1 - u0) / (v1 - v0) : 0;
        const float low = std::min(u0, u1), high = std::max(u0, u1);
        for (int y = from; y <= to; ++y) {
            const float u = std::clamp(u0 + slope * (static_cast<float>(y) - v0), low, high);
            left_[y] = std::min(left_[y], u);
            right_[y] = std::max(right_[y], u);
        }
        if (v0 == v1) {  // lies on a row
            left_[from] = std::min(left_[from], low);
            right_[from] = std::max(right_[from], high);
        }
    }

    const Projector& camera_;
    std::uint8_t* mask_;
    Rect bounds_;
    int count_ = 0;
    float u_[2 * (kMaxArcPieces + kLinePieces + 1)], v_[2 * (kMaxArcPieces + kLinePieces + 1)];
    static thread_local std::vector<float> left_, right_;
};

thread_local std::vector<float> OutlineFiller::left_;
thread_local std::vector<float> OutlineFiller::right_;

class CpuBodySilhouetteRenderer final : public BodySilhouetteRenderer {
  public:
    void render(std::span<const TaperedCapsule> body, std::span<BodyView> views) override {
        check_capsules(body);
        for (BodyView& view : views) {
            const Projector camera = projectors_.get(*view.camera);
            std::memset(view.mask, 0, static_cast<std::size_t>(camera.width) * camera.height);
            OutlineFiller filler(camera, view.mask);
            CameraCapsule capsule;
            for (const TaperedCapsule& c : body)
                if (capsule_in_camera(camera, c, capsule)) filler.draw(capsule);
            view.bounds = filler.bounds();
        }
    }

  private:
    ProjectorCache projectors_;
};

}  // namespace

void check_capsules(std::span<const TaperedCapsule> body) {
    for (const TaperedCapsule& c : body) {
        const float sum = c.a[0] + c.a[1] + c.a[2] + c.b[0] + c.b[1] + c.b[2] + c.radius_a + c.radius_b;
        if (!std::isfinite(sum) || c.radius_a < 0 || c.radius_b < 0)
            throw std::invalid_argument("body silhouette: capsule " + std::to_string(&c - body.data()) +
                                        " has a number that is not finite or a negative radius");
    }
}

Projector ProjectorCache::get(const CameraModel& camera) {
    const bool pinhole =
        camera.k1 == 0 && camera.k2 == 0 && camera.p1 == 0 && camera.p2 == 0 && camera.k3 == 0;
    if (pinhole) return make_projector(camera, "body silhouette: camera");
    for (const auto& [known, projector] : distorted_)
        if (std::memcmp(&known, &camera, sizeof camera) == 0) return projector;
    constexpr std::size_t kKept = 64;
    if (distorted_.size() < kKept) distorted_.emplace_back();
    auto& place = distorted_[next_++ % kKept];
    place = {camera, make_projector(camera, "body silhouette: camera")};
    return place.second;
}

std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer_cpu() {
    return std::make_unique<CpuBodySilhouetteRenderer>();
}

}  // namespace kinevox::kernels
