// From light to grey levels: flicker as gain, Gaussian read noise, 8 bits.
#pragma once

#include <cstdint>
#include <vector>

namespace kinevox::studio {

class Sensor {
  public:
    Sensor(double noise_grey, double flicker, double fps, std::uint32_t seed);

    // Factor on light levels as the camera shows them; 1 +- flicker, the same for all pixels of a frame.
    double gain(std::uint32_t camera, std::int64_t frame) const;

    // One row: grey levels times kGreyScale to 8 bits. `row_key` chooses the noise.
    void expose(const std::uint16_t* light, int count, double gain, std::uint32_t row_key,
                std::uint8_t* out) const;

  private:
    double flicker_, fps_;
    std::uint32_t seed_;
    std::vector<std::int16_t> noise_;  // grey levels times 64, Gaussian
};

}  // namespace kinevox::studio
