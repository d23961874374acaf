#include "common/volume_codec.h"

#include <fmt/format.h>
#include <zstd.h>

#include <bit>
#include <cstring>
#include <memory>

#include "common/volume.h"

namespace kinevox {
namespace {

static_assert(std::endian::native == std::endian::little, "the wire form is little endian");

// docs/volume_format.md describes each field.
constexpr char kMagic[4] = {'K', 'V', 'X', 'V'};
constexpr std::uint8_t kVersion = 1;
constexpr std::uint8_t kHasColours = 1;
constexpr int kShapeSections = 4, kColourSections = 3, kMaxSections = kShapeSections + kColourSections;

struct SectionSizes {
    std::uint32_t raw = 0;     // bytes after decompression
    std::uint32_t stored = 0;  // bytes in the message; as raw where compression did not help
};

#pragma pack(push, 1)
struct Header {
    char magic[4];
    std::uint8_t version;
    std::uint8_t flags;
    std::uint16_t reserved;
    double origin[3];
    double voxel_m;
    std::uint16_t bricks_per_axis[3];
    std::uint16_t reserved_too;
    std::uint32_t brick_count;
    std::uint32_t colour_count;
};
#pragma pack(pop)
static_assert(sizeof(Header) == 56);

struct FreeCompressor {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
};
struct FreeDecompressor {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

std::size_t surface_count(std::span<const BrickBits> surface) {
    std::size_t count = 0;
    for (const BrickBits& brick : surface)
        for (const std::uint64_t slice : brick) count += std::popcount(slice);
    return count;
}

// Appends the section to `out`, compressed where that makes it smaller.
SectionSizes append_section(ZSTD_CCtx* compressor, int level, std::span<const std::uint8_t> raw,
                            std::string& out) {
    const std::size_t start = out.size();
    out.resize(start + ZSTD_compressBound(raw.size()));
    std::size_t stored =
        ZSTD_compressCCtx(compressor, out.data() + start, out.size() - start, raw.data(), raw.size(), level);
    if (ZSTD_isError(stored) || stored >= raw.size()) {
        if (!raw.empty()) std::memcpy(out.data() + start, raw.data(), raw.size());
        stored = raw.size();
    }
    out.resize(start + stored);
    return {static_cast<std::uint32_t>(raw.size()), static_cast<std::uint32_t>(stored)};
}

absl::Status damaged(const std::string& what) {
    return absl::InvalidArgumentError(fmt::format("volume: {}; the bytes are damaged or no volume", what));
}

absl::StatusOr<Header> read_header(std::span<const std::uint8_t> bytes, Volume& volume) {
    Header header;
    if (bytes.size() < sizeof header)
        return damaged(fmt::format("{} bytes are too few for a header", bytes.size()));
    std::memcpy(&header, bytes.data(), sizeof header);
    if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0) return damaged("does not begin with KVXV");
    if (header.version != kVersion)
        return absl::InvalidArgumentError(fmt::format(
            "volume: version {} is not known, expected {}; update this program", header.version, kVersion));
    if ((header.flags & ~kHasColours) != 0 || header.reserved != 0 || header.reserved_too != 0)
        return damaged("a reserved bit is set");
    volume.grid.origin_in_world = {header.origin[0], header.origin[1], header.origin[2]};
    volume.grid.voxel_m = header.voxel_m;
    for (int axis = 0; axis < 3; ++axis) volume.grid.size[axis] = 8 * header.bricks_per_axis[axis];
    if (const std::string problem = volume_problem(volume); !problem.empty()) return damaged(problem);
    if (header.brick_count > kMaxBricks || header.colour_count > kMaxCodedColours)
        return damaged(fmt::format("{} bricks and {} colours exceed the limits", header.brick_count,
                                   header.colour_count));
    if (!(header.flags & kHasColours) && header.colour_count != 0)
        return damaged("has colours and says it has none");
    return header;
}

// Whether the sections can be what their header says, before anything of their size is allocated.
bool plausible(const Header& header, std::span<const SectionSizes> sizes) {
    const std::uint64_t bricks = header.brick_count;
    const bool gaps = sizes[0].raw >= bricks && sizes[0].raw <= 7 * bricks;  // brick indices are below 2^45
    const bool masks = sizes[1].raw == 2 * bricks;
    const bool octants = sizes[2].raw % 2 == 0 && sizes[2].raw <= 2 * 8 * bricks;
    const bool cells = sizes[3].raw <= std::uint64_t{4} * sizes[2].raw;  // 8 of an octant's 2 bytes
    bool colours = true;
    for (std::size_t i = kShapeSections; i < sizes.size(); ++i)
        colours = colours && sizes[i].raw == header.colour_count;
    return gaps && masks && octants && cells && colours;
}

}  // namespace

std::string encode_volume(const Volume& volume, const VolumeCodecOptions& options) {
    if (!volume_problem(volume).empty()) return "";
    std::vector<BrickBits> surface;
    bool with_colours = options.with_colours && !volume.colours.empty();
    if (with_colours) {
        surface = surface_bits(volume.grid, volume.bricks);
        with_colours =
            surface_count(surface) == volume.colours.size() && volume.colours.size() <= kMaxCodedColours;
    }
    Header header{};
    std::memcpy(header.magic, kMagic, sizeof kMagic);
    header.version = kVersion;
    header.flags = with_colours ? kHasColours : 0;
    header.origin[0] = volume.grid.origin_in_world.x;
    header.origin[1] = volume.grid.origin_in_world.y;
    header.origin[2] = volume.grid.origin_in_world.z;
    header.voxel_m = volume.grid.voxel_m;
    for (int axis = 0; axis < 3; ++axis)
        header.bricks_per_axis[axis] = static_cast<std::uint16_t>(volume.grid.size[axis] / 8);
    header.brick_count = static_cast<std::uint32_t>(volume.bricks.size());
    header.colour_count = with_colours ? static_cast<std::uint32_t>(volume.colours.size()) : 0;

    const ShapeSections shape = encode_shape(volume);
    const ColourSections colours = with_colours ? encode_colours(surface, volume.colours) : ColourSections{};
    const std::span<const std::uint8_t> sections[kMaxSections] = {
        shape.gaps, shape.bricks, shape.octants, shape.cells, colours.luma, colours.orange, colours.green};
    const int section_count = with_colours ? kMaxSections : kShapeSections;

    const std::unique_ptr<ZSTD_CCtx, FreeCompressor> compressor(ZSTD_createCCtx());
    SectionSizes sizes[kMaxSections];
    std::string out(sizeof header + section_count * sizeof(SectionSizes), '\0');
    for (int i = 0; i < section_count; ++i)
        sizes[i] = append_section(compressor.get(), options.zstd_level, sections[i], out);
    std::memcpy(out.data(), &header, sizeof header);
    std::memcpy(out.data() + sizeof header, sizes, section_count * sizeof(SectionSizes));
    return out;
}

absl::StatusOr<Volume> decode_volume(std::span<const std::uint8_t> bytes) {
    Volume volume;
    const absl::StatusOr<Header> header = read_header(bytes, volume);
    if (!header.ok()) return header.status();
    const int section_count = header->flags & kHasColours ? kMaxSections : kShapeSections;
    bytes = bytes.subspan(sizeof(Header));
    SectionSizes sizes[kMaxSections];
    if (bytes.size() < section_count * sizeof(SectionSizes)) return damaged("ends within the header");
    std::memcpy(sizes, bytes.data(), section_count * sizeof(SectionSizes));
    bytes = bytes.subspan(section_count * sizeof(SectionSizes));
    std::uint64_t stored_total = 0;
    for (int i = 0; i < section_count; ++i) stored_total += sizes[i].stored;
    if (stored_total != bytes.size())
        return damaged(
            fmt::format("holds {} bytes of sections, its header says {}", bytes.size(), stored_total));
    if (!plausible(*header, {sizes, static_cast<std::size_t>(section_count)}))
        return damaged("the sections' sizes contradict the number of bricks or colours");

    const std::unique_ptr<ZSTD_DCtx, FreeDecompressor> decompressor(ZSTD_createDCtx());
    std::vector<std::uint8_t> unpacked[kMaxSections];
    std::span<const std::uint8_t> sections[kMaxSections];
    for (int i = 0; i < section_count; ++i) {
        const std::span<const std::uint8_t> stored = bytes.first(sizes[i].stored);
        bytes = bytes.subspan(sizes[i].stored);
        if (sizes[i].stored == sizes[i].raw) {
            sections[i] = stored;
            continue;
        }
        // A zstd frame states its size: allocate only if it equals the header's.
        if (ZSTD_getFrameContentSize(stored.data(), stored.size()) != sizes[i].raw)
            return damaged(fmt::format("section {} does not hold what the header says", i));
        unpacked[i].resize(sizes[i].raw);
        const std::size_t got = ZSTD_decompressDCtx(decompressor.get(), unpacked[i].data(),
                                                    unpacked[i].size(), stored.data(), stored.size());
        if (ZSTD_isError(got) || got != sizes[i].raw)
            return damaged(fmt::format("section {} cannot be unpacked", i));
        sections[i] = unpacked[i];
    }

    const std::string shape_problem =
        decode_shape({sections[0], sections[1], sections[2], sections[3]}, header->brick_count, volume);
    if (!shape_problem.empty()) return damaged(shape_problem);
    if (!(header->flags & kHasColours)) return volume;
    const std::vector<BrickBits> surface = surface_bits(volume.grid, volume.bricks);
    if (surface_count(surface) != header->colour_count)
        return damaged("there is not one colour a surface voxel");
    if (!decode_colours({sections[4], sections[5], sections[6]}, surface, volume.colours))
        return damaged("a colour is out of range");
    return volume;
}

}  // namespace kinevox
