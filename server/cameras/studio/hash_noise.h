// Random numbers without state: hashes of integers, and smooth noise from them. The same everywhere, always.
#pragma once

#include <cmath>
#include <cstdint>

namespace kinevox::studio {

inline std::uint32_t hash_u32(std::uint32_t x) {
    x ^= x >> 16;
    x *= 0x7feb352dU;
    x ^= x >> 15;
    x *= 0x846ca68bU;
    return x ^ (x >> 16);
}
inline std::uint32_t hash_u32(std::uint32_t a, std::uint32_t b, std::uint32_t c = 0) {
    return hash_u32(a ^ hash_u32(b ^ hash_u32(c + 0x9e3779b9U) * 0x85ebca6bU));
}
// 0..1
inline float hash_unit(std::uint32_t a, std::uint32_t b = 0, std::uint32_t c = 0) {
    return static_cast<float>(hash_u32(a, b, c) >> 8) * (1.0f / 16777216.0f);
}

// Value noise, 0..1, one bump a unit of x and y.
inline float smooth_noise(float x, float y, std::uint32_t seed) {
    const float fx = std::floor(x), fy = std::floor(y);
    const auto ix = static_cast<std::uint32_t>(static_cast<int>(fx));
    const auto iy = static_cast<std::uint32_t>(static_cast<int>(fy));
    float u = x - fx, v = y - fy;
    u = u * u * (3 - 2 * u);
    v = v * v * (3 - 2 * v);
    const float a = hash_unit(ix, iy, seed), b = hash_unit(ix + 1, iy, seed);
    const float c = hash_unit(ix, iy + 1, seed), d = hash_unit(ix + 1, iy + 1, seed);
    return (a + (b - a) * u) * (1 - v) + (c + (d - c) * u) * v;
}
// Four octaves, mean 0.5.
inline float fractal_noise(float x, float y, std::uint32_t seed) {
    float sum = 0, weight = 0.5333f;
    for (std::uint32_t octave = 0; octave < 4; ++octave) {
        sum += weight * smooth_noise(x, y, seed + octave);
        weight *= 0.5f;
        x = 2.03f * x + 11.3f;
        y = 2.03f * y + 4.7f;
    }
    return sum;
}

inline float smoothstep(float edge0, float edge1, float x) {
    float t = (x - edge0) / (edge1 - edge0);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}

}  // namespace kinevox::studio
