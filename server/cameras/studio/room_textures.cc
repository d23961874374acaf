#include <algorithm>
#include <cmath>

#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/room.h"

namespace kinevox::studio {
namespace {

std::uint32_t cell(float x) {
    return static_cast<std::uint32_t>(static_cast<int>(std::floor(x)));
}
float fraction(float x) {
    return x - std::floor(x);
}

Albedo bright_colour(std::uint32_t a, std::uint32_t b) {
    const float hue = 6 * hash_unit(a, b, 1), value = 0.08f + 0.45f * hash_unit(a, b, 2);
    const auto channel = [&](float shift) {
        const float h = std::fmod(hue + shift, 6.0f);
        return value * (0.15f + 0.85f * std::clamp(std::abs(h - 3.0f) - 1.0f, 0.0f, 1.0f));
    };
    return {channel(0), channel(4), channel(2)};
}

Albedo wood(Albedo base, float along, float across, std::uint32_t seed) {
    const float grain = fractal_noise(1.2f * along, 22.0f * across, seed);
    const float rings =
        0.5f + 0.5f * std::sin(55.0f * across + 9.0f * fractal_noise(0.9f * along, 3.0f * across, seed + 9));
    return times(base, 0.62f + 0.55f * grain + 0.14f * rings);
}

Albedo wood_floor(const Texture& t, float u, float v) {
    constexpr float kPlank = 0.16f, kLength = 1.4f;
    const std::uint32_t row = cell(v / kPlank);
    const float shifted = u + kLength * hash_unit(row, t.seed, 3);
    const std::uint32_t plank = hash_u32(row, cell(shifted / kLength), t.seed);
    const float gap_v = std::min(fraction(v / kPlank), 1 - fraction(v / kPlank)) * kPlank;
    const float gap_u = std::min(fraction(shifted / kLength), 1 - fraction(shifted / kLength)) * kLength;
    const float joint = std::min(gap_u, gap_v) < 0.0025f ? 0.45f : 1.0f;
    const Albedo tone = times(t.base, 0.72f + 0.5f * hash_unit(plank, 4));
    return times(wood(tone, u, v + 3.7f * hash_unit(plank, 5), t.seed + plank % 97), joint);
}

Albedo brick(const Texture& t, float u, float v) {
    constexpr float kHigh = 0.085f, kLong = 0.26f;
    const std::uint32_t row = cell(v / kHigh);
    const float x = u / kLong + (row & 1 ? 0.5f : 0.0f);
    const float gap = std::min(std::min(fraction(x), 1 - fraction(x)) * kLong,
                               std::min(fraction(v / kHigh), 1 - fraction(v / kHigh)) * kHigh);
    const float rough = 0.80f + 0.4f * fractal_noise(30 * u, 30 * v, t.seed);
    if (gap < 0.006f) return times({0.36f, 0.34f, 0.31f}, rough);
    return times(t.base, rough * (0.70f + 0.6f * hash_unit(row, cell(x), t.seed)));
}

Albedo shelf(const Texture& t, float u, float v) {
    const Albedo board{0.10f, 0.06f, 0.035f};
    constexpr float kTier = 0.34f;
    const float in_tier = fraction(v / kTier) * kTier;
    if (in_tier < 0.03f || u < 0.025f) return wood(board, u, v, t.seed);
    const std::uint32_t tier = cell(v / kTier), group = cell(u / 0.28f), book = cell(u / 0.037f);
    if (hash_unit(tier, group, t.seed) < 0.12f) return times(board, 0.35f);
    const float high = 0.17f + 0.11f * hash_unit(tier, book, t.seed + 2);
    if (in_tier > 0.03f + high) return times(board, 0.4f);
    const float edge = std::min(fraction(u / 0.037f), 1 - fraction(u / 0.037f));
    const bool label = in_tier > 0.03f + 0.7f * high && in_tier < 0.03f + 0.85f * high;
    const Albedo cover = bright_colour(hash_u32(tier, book), t.seed);
    return times(label ? mix(cover, {0.6f, 0.58f, 0.5f}, 0.6f) : cover, edge < 0.1f ? 0.4f : 1.0f);
}

Albedo cabinet(const Texture& t, float u, float v, float u_length, float v_length) {
    const float drawers = std::max(2.0f, std::round(v_length / 0.32f)), y = fraction(v / v_length * drawers);
    const float columns = std::max(1.0f, std::round(u_length / 0.6f)), x = fraction(u / u_length * columns);
    const Albedo base = times(t.base, 0.94f + 0.12f * fractal_noise(3 * u, 3 * v, t.seed));
    if (std::min(y, 1 - y) < 0.03f || std::min(x, 1 - x) < 0.018f) return times(base, 0.5f);
    if (std::abs(x - 0.5f) < 0.12f && std::abs(y - 0.7f) < 0.05f) return {0.05f, 0.05f, 0.055f};
    return base;
}

}  // namespace

Albedo texture_at(const Texture& t, float u, float v, float u_length, float v_length) {
    const auto grain = [&] { return 0.93f + 0.14f * fractal_noise(7 * u, 7 * v, t.seed); };
    switch (t.kind) {
        case TextureKind::kPaint: {
            const float skirting = v < 0.10f ? 0.22f : v < 0.108f ? 0.5f : 1.0f;
            const float stains = 0.94f + 0.12f * fractal_noise(0.8f * u, 0.8f * v, t.seed + 5);
            return times(t.base, grain() * stains * skirting);
        }
        case TextureKind::kPanelling: {
            if (v > 1.05f)
                return texture_at({TextureKind::kPaint, {0.55f, 0.54f, 0.50f}, t.seed}, u, v, u_length,
                                  v_length);
            const float groove = fraction(u / 0.42f);
            const float rail = v > 0.98f || v < 0.10f ? 0.7f : 1.0f;
            return times(t.base, grain() * rail * (groove < 0.02f ? 0.5f : 1.0f));
        }
        case TextureKind::kBrick:
            return v < 0.10f ? times({0.12f, 0.11f, 0.10f}, grain()) : brick(t, u, v);
        case TextureKind::kWoodFloor:
            return wood_floor(t, u, v);
        case TextureKind::kConcrete: {
            const float cloud = fractal_noise(0.7f * u, 0.7f * v, t.seed),
                        fine = fractal_noise(14 * u, 14 * v, t.seed + 3);
            const float joint = std::min(fraction(u / 3), fraction(v / 3)) * 3 < 0.012f ? 0.6f : 1.0f;
            return times(t.base, (0.66f + 0.42f * cloud + 0.26f * fine) * joint);
        }
        case TextureKind::kTrack: {
            const float fine = smooth_noise(55 * u, 55 * v, t.seed),
                        cloud = fractal_noise(0.6f * u, 0.6f * v, t.seed + 1);
            return times(t.base, 0.72f + 0.26f * fine + 0.30f * cloud);
        }
        case TextureKind::kCeiling: {
            const float joint =
                std::min(fraction(u / 0.6f), fraction(v / 0.6f)) * 0.6f < 0.012f ? 0.75f : 1.0f;
            return times(t.base, grain() * joint);
        }
        case TextureKind::kShelf:
            return shelf(t, u, v);
        case TextureKind::kCabinet:
            return cabinet(t, u, v, u_length, v_length);
        case TextureKind::kWood:
            return wood(t.base, u, v, t.seed);
        case TextureKind::kCrate: {
            const float edge = std::min(std::min(u, u_length - u), std::min(v, v_length - v));
            const bool tape = std::abs(u - 0.5f * u_length) < 0.03f;
            return times(t.base, grain() * (edge < 0.012f ? 0.6f : tape ? 1.3f : 1.0f));
        }
        case TextureKind::kScreen: {
            const float edge = std::min(std::min(u, u_length - u), std::min(v, v_length - v));
            return edge < 0.02f ? Albedo{0.02f, 0.02f, 0.02f} : times({0.03f, 0.05f, 0.08f}, grain());
        }
        case TextureKind::kMat:
            return times(t.base, 0.85f + 0.3f * smooth_noise(40 * u, 40 * v, t.seed));
        case TextureKind::kLamp:
            return {3, 3, 2.9f};
    }
    return t.base;
}

Albedo decal_at(const Decal& d, float u, float v) {
    const float x = (u - d.u0) / (d.u1 - d.u0), y = (v - d.v0) / (d.v1 - d.v0);
    const float edge = std::min(std::min(u - d.u0, d.u1 - u), std::min(v - d.v0, d.v1 - v));
    switch (d.kind) {
        case DecalKind::kPoster: {
            if (edge < 0.02f) return {0.65f, 0.64f, 0.6f};
            Albedo colour = d.base;
            for (std::uint32_t i = 0; i < 6; ++i) {  // overlapping discs and bars
                const float cx = hash_unit(d.seed, i, 1), cy = 0.3f + 0.7f * hash_unit(d.seed, i, 2);
                const float r = 0.06f + 0.16f * hash_unit(d.seed, i, 3);
                const bool disc = (x - cx) * (x - cx) + (y - cy) * (y - cy) < r * r;
                const bool bar = std::abs(x - cx) < r && std::abs(y - cy) < 0.4f * r;
                if (i % 2 ? disc : bar) colour = bright_colour(d.seed, i);
            }
            if (y < 0.22f && fraction(y / 0.055f) < 0.5f && x > 0.1f &&
                x < 0.55f + 0.4f * hash_unit(d.seed, cell(y / 0.055f), 9))
                return {0.04f, 0.04f, 0.05f};
            return colour;
        }
        case DecalKind::kWhiteboard: {
            if (edge < 0.025f) return {0.30f, 0.30f, 0.31f};
            const float line = std::abs(fractal_noise(3.0f * u, 4.0f * v, d.seed) - 0.5f);
            return line < 0.006f ? Albedo{0.03f, 0.05f, 0.20f} : Albedo{0.70f, 0.71f, 0.71f};
        }
        case DecalKind::kDoor: {
            if (edge < 0.07f && y > 0.03f) return {0.50f, 0.48f, 0.44f};
            if (std::abs(x - 0.86f) < 0.03f && std::abs(v - 1.02f) < 0.02f) return {0.35f, 0.35f, 0.35f};
            return wood(d.base, v, u, d.seed);
        }
        case DecalKind::kLampPanel:
            return {3, 3, 2.9f};
        case DecalKind::kTape:
        case DecalKind::kLaneLine:
            return times(d.base, 0.82f + 0.3f * smooth_noise(30 * u, 30 * v, d.seed));
    }
    return d.base;
}

}  // namespace kinevox::studio
