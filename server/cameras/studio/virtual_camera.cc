#include "server/cameras/studio/virtual_camera.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/room.h"

namespace kinevox::studio {
namespace {

constexpr int kNoiseStarts = 1 << 15;
constexpr int kNoiseScale = 64;

}  // namespace

Sensor::Sensor(double noise_grey, double flicker, double fps, std::uint32_t seed, double shot_noise_grey)
    : flicker_(flicker), fps_(fps), seed_(seed), noise_(2 * kNoiseStarts) {
    constexpr float kTwoPi = 6.2831853f;
    for (std::size_t i = 0; i < noise_.size(); ++i) {  // Box-Muller
        const auto n = static_cast<std::uint32_t>(i);
        const float radius = std::sqrt(-2.0f * std::log(hash_unit(n, seed, 41) + 3e-8f));
        const float value =
            radius * std::cos(kTwoPi * hash_unit(n, seed, 42)) * static_cast<float>(noise_grey) * kNoiseScale;
        // Half a step more, since expose() truncates.
        noise_[i] =
            static_cast<std::int16_t>(std::lround(std::clamp(value, -8000.0f, 8000.0f)) + kNoiseScale / 2);
    }
    if (shot_noise_grey <= 0) return;
    const double own = std::max(noise_grey, 1e-3);
    for (int grey = 0; grey < 256; ++grey)  // its variance grows with the light, not with what is shown of it
        scale_.push_back(static_cast<std::int32_t>(std::lround(
            256 * std::min(std::hypot(own, shot_noise_grey * std::pow(grey / 255.0, 0.6)) / own, 100.0))));
}

double Sensor::gain(std::uint32_t camera, std::int64_t frame) const {
    const double t = static_cast<double>(frame) / fps_;
    // Flicker of mains light aliases with the frame rate; ballasts add noise.
    const double aliasing = std::sin(6.283185307179586 * (2.3 * t + hash_unit(seed_, 43)));
    const double jitter = 2 * hash_unit(seed_ + camera, static_cast<std::uint32_t>(frame), 44) - 1;
    return 1.0 + flicker_ * (0.8 * aliasing + 0.2 * jitter);
}

// The noise at this level; half a step stays, since expose() truncates.
int Sensor::scaled(int level, int noise) const {
    const int grey = std::clamp(level >> 6, 0, 255), half = kNoiseScale / 2;
    return half + (((noise - half) * scale_[static_cast<std::size_t>(grey)]) >> 8);
}

void Sensor::expose(const std::uint16_t* light, int count, double gain, std::uint32_t row_key,
                    std::uint8_t* out) const {
    constexpr int kMaxLight = 255 * kNoiseScale + kNoiseScale - 1;
    const auto factor = static_cast<std::uint32_t>(
        std::lround(std::clamp(gain, 0.5, 1.5) * 65536.0 * kNoiseScale / kGreyScale));
    for (int done = 0, part = 0; done < count; ++part) {
        const int here = std::min(count - done, kNoiseStarts);
        const std::int16_t* noise =
            &noise_[hash_u32(row_key, static_cast<std::uint32_t>(part)) % kNoiseStarts];
        for (int i = 0; i < here; ++i) {
            const auto level = static_cast<std::int16_t>((light[done + i] * factor) >> 16);
            const auto noisy =
                static_cast<std::int16_t>(level + (scale_.empty() ? noise[i] : scaled(level, noise[i])));
            const std::int16_t low = noisy < 0 ? std::int16_t{0} : noisy;
            out[done + i] = static_cast<std::uint8_t>((low > kMaxLight ? kMaxLight : low) >> 6);
        }
        done += here;
    }
}

}  // namespace kinevox::studio
