// C3D: header, parameters and data in blocks of 512 bytes, after the format's user guide (www.c3d.org): Intel
// order, floats (negative POINT:SCALE), no analog channels.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>

#include "common/files.h"
#include "server/recording/trial_formats.h"

namespace kinevox {
namespace {

constexpr std::size_t kBlock = 512;
constexpr int kIntel = 84;
constexpr std::size_t kMaxShortFrames = 65535;  // in a 16-bit word; more need TRIAL and LONG_FRAMES

// A number of any size, little endian.
template <class T>
void put(std::string& out, T value) {
    if constexpr (std::is_floating_point_v<T>) {
        put(out, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
    } else {
        put_little_endian(out, value);
    }
}

void fill_block(std::string& out) {
    out.resize((out.size() + kBlock - 1) / kBlock * kBlock, '\0');
}

// The parameter section: groups have negative numbers, their parameters the positive one.
class Parameters {
  public:
    void group(std::string_view name, std::string_view description) {
        ++group_;
        entry(name, -group_, "", description);
    }
    void integers(std::string_view name, std::span<const std::uint16_t> values,
                  std::string_view description) {
        std::string data = shape(2, values.size());
        for (const std::uint16_t value : values) put(data, value);
        entry(name, group_, data, description);
    }
    void integer(std::string_view name, std::uint16_t value, std::string_view description) {
        integers(name, std::span(&value, 1), description);
    }
    void number(std::string_view name, double value, std::string_view description) {
        std::string data = shape(4, 1);
        put(data, static_cast<float>(value));
        entry(name, group_, data, description);
    }
    void text(std::string_view name, std::string_view value, std::string_view description) {
        entry(name, group_, fmt::format("\xff\x01{}{}", static_cast<char>(value.size()), value), description);
    }
    // Padded with blanks to the longest one, 255 bytes at most.
    void texts(std::string_view name, std::span<const std::string> values, std::string_view description) {
        std::size_t longest = 0;
        for (const std::string& value : values) longest = std::max(longest, value.size());
        std::string data = "\xff\x02";
        put(data, static_cast<std::uint8_t>(longest));
        put(data, static_cast<std::uint8_t>(values.size()));
        for (const std::string& value : values) data += value + std::string(longest - value.size(), ' ');
        entry(name, group_, data, description);
    }

    // The whole section; an entry without a name ends it.
    std::string bytes() const {
        std::string out{'\x01', '\x50', '\0', static_cast<char>(kIntel)};
        out += entries_;
        out += '\0';
        fill_block(out);
        out[2] = static_cast<char>(out.size() / kBlock);
        return out;
    }

  private:
    // Type and dimensions; a single number has none.
    static std::string shape(int bytes, std::size_t count) {
        std::string data(1, static_cast<char>(bytes));
        data += count == 1 ? '\0' : '\x01';
        if (count != 1) put(data, static_cast<std::uint8_t>(count));
        return data;
    }
    void entry(std::string_view name, int number, const std::string& data, std::string_view description) {
        put(entries_, static_cast<std::uint8_t>(name.size()));
        put(entries_, static_cast<std::int8_t>(number));
        entries_ += name;
        // From the offset itself to the next entry.
        put(entries_, static_cast<std::uint16_t>(2 + data.size() + 1 + description.size()));
        entries_ += data;
        put(entries_, static_cast<std::uint8_t>(description.size()));
        entries_ += description;
    }
    std::string entries_;
    int group_ = 0;
};

double max_mm(const Trial& trial) {
    double largest = 0;
    for (const auto& joints : trial.joints)
        for (const Vec3& p : joints)
            if (!std::isnan(p.x)) largest = std::max({largest, std::abs(p.x), std::abs(p.y), std::abs(p.z)});
    return 1000 * largest;
}

// POINT:SCALE's magnitude, for programs that convert the file to 16-bit integers.
double scale_of(const Trial& trial) {
    return -std::max(max_mm(trial), 1.0) / 32000;
}

std::string parameter_section(const Trial& trial, std::uint16_t data_block) {
    const std::vector<std::string> labels(kJointNames.begin(), kJointNames.end()),
        descriptions(kJointDescriptions.begin(), kJointDescriptions.end());
    const std::uint64_t frames = trial.size();
    Parameters p;
    p.group("POINT", "joint centres");
    p.integer("USED", kJointNames.size(), "points");
    p.number("SCALE", scale_of(trial), "negative: floats");
    p.number("RATE", trial.rate_hz, "frames per second");
    p.integer("DATA_START", data_block, "block of the first frame");
    p.integer("FRAMES", static_cast<std::uint16_t>(std::min<std::uint64_t>(frames, kMaxShortFrames)),
              "frames");
    if (frames > kMaxShortFrames) p.number("LONG_FRAMES", static_cast<double>(frames), "frames");
    p.texts("LABELS", labels, "names");
    p.texts("DESCRIPTIONS", descriptions, "what the points are");
    p.text("UNITS", "mm", "of the coordinates");
    p.text("X_SCREEN", "+X", "axis shown to the right");
    p.text("Y_SCREEN", "+Z", "axis shown upwards");
    p.group("ANALOG", "none");
    p.integer("USED", 0, "channels");
    p.number("GEN_SCALE", 1, "of all channels");
    p.number("RATE", trial.rate_hz, "samples per second");
    p.group("TRIAL", "first and last frame, two words each");
    p.integers("ACTUAL_START_FIELD", std::array<std::uint16_t, 2>{1, 0}, "first frame");
    p.integers("ACTUAL_END_FIELD",
               std::array{static_cast<std::uint16_t>(frames), static_cast<std::uint16_t>(frames >> 16)},
               "last frame");
    p.number("CAMERA_RATE", trial.rate_hz, "frames per second");
    if (!trial.subject_name.empty()) {
        p.group("SUBJECTS", "who the points belong to");
        p.integer("USED", 1, "subjects");
        p.texts("NAMES", std::span(&trial.subject_name, 1), "UTF-8");
    }
    p.group("MANUFACTURER", "software");
    p.text("COMPANY", "Kinevox", "");
    p.text("SOFTWARE", "kinevox export", "");
    return p.bytes();
}

std::string header_section(const Trial& trial, std::uint16_t data_block) {
    std::string out{'\x02', '\x50'};  // the parameters' first block, counted from 1, and the key
    put(out, static_cast<std::uint16_t>(kJointNames.size()));
    put(out, std::uint16_t{0});  // analog values per frame
    put(out, std::uint16_t{1});  // first and last frame
    put(out, static_cast<std::uint16_t>(std::min(trial.size(), kMaxShortFrames)));
    put(out, std::uint16_t{0});  // no gap was interpolated
    put(out, static_cast<float>(scale_of(trial)));
    put(out, data_block);
    put(out, std::uint16_t{0});  // analog samples per frame
    put(out, static_cast<float>(trial.rate_hz));
    out.resize(kBlock, '\0');
    constexpr std::size_t kLongLabels = 2 * 149;  // word 150: event labels have four characters
    out[kLongLabels] = '\x39';
    out[kLongLabels + 1] = '\x30';
    return out;
}

}  // namespace

absl::StatusOr<std::string> c3d_file(const Trial& trial) {
    constexpr std::size_t kMaxFrames = std::size_t{1} << 24;  // LONG_FRAMES, a float, is exact up to here
    if (trial.size() > kMaxFrames)
        return absl::InvalidArgumentError(
            fmt::format("{}: {} frames exceed C3D's limit of {}; export part of them with --range",
                        trial.folder.string(), trial.size(), kMaxFrames));
    const std::size_t parameter_blocks = parameter_section(trial, 0).size() / kBlock;
    const auto data_block = static_cast<std::uint16_t>(2 + parameter_blocks);
    std::string out = header_section(trial, data_block) + parameter_section(trial, data_block);
    out.reserve(out.size() + trial.size() * kJointNames.size() * 16 + kBlock);
    for (const auto& joints : trial.joints)
        for (const Vec3& p : joints) {
            const bool valid = !std::isnan(p.x);
            for (const double value : {p.x, p.y, p.z}) put(out, static_cast<float>(valid ? 1000 * value : 0));
            put(out, valid
                         ? 0.0f
                         : -1.0f);  // residual and cameras: 0 for a point that was computed, not triangulated
        }
    fill_block(out);
    return out;
}

}  // namespace kinevox
