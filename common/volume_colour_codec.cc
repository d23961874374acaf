#include <bit>

#include "common/volume_codec.h"

namespace kinevox {
namespace {

constexpr int kMaxCoded = 63;  // six bits a channel

// Nearest of 64 levels from 0 to 255 and back: off by 2 at most, black and white exact, twice is as good as
// once.
constexpr std::array<std::uint8_t, 256> make_coded_levels() {
    std::array<std::uint8_t, 256> table{};
    for (int level = 0; level < 256; ++level)
        table[level] = static_cast<std::uint8_t>((level * 63 + 127) / 255);
    return table;
}
constexpr std::array<std::uint8_t, 64> make_levels() {
    std::array<std::uint8_t, 64> table{};
    for (int coded = 0; coded < 64; ++coded)
        table[coded] = static_cast<std::uint8_t>((coded * 255 + 31) / 63);
    return table;
}
constexpr auto kCodedFromLevel = make_coded_levels();
constexpr auto kLevelFromCoded = make_levels();

// YCoCg-R (Malvar and Sullivan 2003): reversible in whole numbers, and most colours differ in Y alone.
struct YCoCg {
    std::int16_t y = 0, co = 0, cg = 0;
};

YCoCg ycocg_from_rgb(Rgb colour) {
    const int r = kCodedFromLevel[colour.r], g = kCodedFromLevel[colour.g], b = kCodedFromLevel[colour.b];
    const int co = r - b, t = b + (co >> 1), cg = g - t, y = t + (cg >> 1);
    return {static_cast<std::int16_t>(y), static_cast<std::int16_t>(co), static_cast<std::int16_t>(cg)};
}

// False where it is no colour that ycocg_from_rgb() gives.
bool rgb_from_ycocg(YCoCg c, Rgb& colour) {
    const int t = c.y - (c.cg >> 1), g = c.cg + t, b = t - (c.co >> 1), r = b + c.co;
    if ((r | g | b) & ~kMaxCoded) return false;  // negative ones too
    colour = {kLevelFromCoded[r], kLevelFromCoded[g], kLevelFromCoded[b]};
    return true;
}

// Walks the surface voxels of all bricks in order and predicts each colour from up to two neighbours that
// came before in the same brick, else from the colour just before.
class Predictor {
  public:
    // Starts a brick.
    void start(const BrickBits& surface) { surface_ = &surface; }

    // For voxel (x, y, z) of the brick, `bit` = y * 8 + x. A neighbour counts if it is a surface voxel.
    YCoCg predict(int z, int bit) const {
        const int x = bit & 7;
        const std::uint64_t here = (*surface_)[z];
        const std::uint64_t below = z > 0 ? (*surface_)[z - 1] : 0;
        const YCoCg* found = nullptr;
        const YCoCg* const slice = known_.data() + z * 64 + bit;
        // In this order: the four that touch in this slice or the one below, then the diagonal ones.
        if (x > 0 && (here >> (bit - 1) & 1)) found = slice - 1;
        if (bit >= 8 && (here >> (bit - 8) & 1)) {
            if (found) return mean(*found, slice[-8]);
            found = slice - 8;
        }
        if (below >> bit & 1) {
            if (found) return mean(*found, slice[-64]);
            found = slice - 64;
        }
        if (x < 7 && bit >= 8 && (here >> (bit - 7) & 1)) {
            if (found) return mean(*found, slice[-7]);
            found = slice - 7;
        }
        if (x > 0 && bit >= 9 && (here >> (bit - 9) & 1)) {
            if (found) return mean(*found, slice[-9]);
            found = slice - 9;
        }
        if (x > 0 && (below >> (bit - 1) & 1)) {
            if (found) return mean(*found, slice[-65]);
            found = slice - 65;
        }
        if (x < 7 && (below >> (bit + 1) & 1)) {
            if (found) return mean(*found, slice[-63]);
            found = slice - 63;
        }
        if (bit >= 8 && (below >> (bit - 8) & 1)) {
            if (found) return mean(*found, slice[-72]);
            found = slice - 72;
        }
        if (bit < 56 && (below >> (bit + 8) & 1)) {
            if (found) return mean(*found, slice[-56]);
            found = slice - 56;
        }
        return found ? *found : last_;
    }

    void learn(int z, int bit, YCoCg colour) { known_[z * 64 + bit] = last_ = colour; }

  private:
    static YCoCg mean(YCoCg a, YCoCg b) {
        const auto half = [](int sum) { return static_cast<std::int16_t>(sum >> 1); };
        return {half(a.y + b.y), half(a.co + b.co), half(a.cg + b.cg)};
    }
    const BrickBits* surface_ = nullptr;
    std::array<YCoCg, 512> known_{};  // of this brick where a surface voxel came before
    YCoCg last_;
};

}  // namespace

ColourSections encode_colours(std::span<const BrickBits> surface, std::span<const Rgb> colours) {
    ColourSections out;
    out.luma.resize(colours.size());
    out.orange.resize(colours.size());
    out.green.resize(colours.size());
    Predictor predictor;
    std::size_t i = 0;
    for (const BrickBits& brick : surface) {
        predictor.start(brick);
        for (int z = 0; z < 8; ++z)
            for (std::uint64_t left = brick[z]; left != 0; left &= left - 1, ++i) {
                const int bit = std::countr_zero(left);
                const YCoCg colour = ycocg_from_rgb(colours[i]);
                const YCoCg predicted = predictor.predict(z, bit);
                out.luma[i] = static_cast<std::uint8_t>(colour.y - predicted.y);
                out.orange[i] = static_cast<std::uint8_t>(colour.co - predicted.co);
                out.green[i] = static_cast<std::uint8_t>(colour.cg - predicted.cg);
                predictor.learn(z, bit, colour);
            }
    }
    return out;
}

bool decode_colours(const ColourBytes& sections, std::span<const BrickBits> surface,
                    std::vector<Rgb>& colours) {
    colours.resize(sections.luma.size());
    Predictor predictor;
    std::size_t i = 0;
    for (const BrickBits& brick : surface) {
        predictor.start(brick);
        for (int z = 0; z < 8; ++z)
            for (std::uint64_t left = brick[z]; left != 0; left &= left - 1, ++i) {
                const int bit = std::countr_zero(left);
                const YCoCg predicted = predictor.predict(z, bit);
                // Errors are whole numbers modulo 256; the true values span less than that.
                const auto restored = [](int prediction, std::uint8_t error) {
                    return static_cast<std::int16_t>(static_cast<std::int8_t>(prediction + error));
                };
                const YCoCg colour{restored(predicted.y, sections.luma[i]),
                                   restored(predicted.co, sections.orange[i]),
                                   restored(predicted.cg, sections.green[i])};
                if (!rgb_from_ycocg(colour, colours[i])) return false;
                predictor.learn(z, bit, colour);
            }
    }
    return true;
}

}  // namespace kinevox
