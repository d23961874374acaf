// What `kinevox export`, `kinevox record export` and the API export: formats and ranges of frames. A new
// format is added here, with its writer in server/recording/recording_export.cc.
#pragma once

#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string_view>
#include <system_error>

namespace kinevox {

// The values are those of v1::ExportFormat.
enum class ExportFormat { kTrc = 1, kMot, kC3d, kBvh, kCsv, kPly, kMp4, kSession };

struct ExportFormatInfo {
    ExportFormat format;
    std::string_view name;  // on the command line, and a single file's extension
    bool many_files;        // writes a folder of files
    std::string_view what;  // for help texts
};
inline constexpr std::array kExportFormats{
    ExportFormatInfo{ExportFormat::kTrc, "trc", false, "marker positions (OpenSim)"},
    ExportFormatInfo{ExportFormat::kMot, "mot", false, "model coordinates (OpenSim)"},
    ExportFormatInfo{ExportFormat::kC3d, "c3d", false, "points and angles (C3D)"},
    ExportFormatInfo{ExportFormat::kBvh, "bvh", false, "skeleton animation (BVH)"},
    ExportFormatInfo{ExportFormat::kCsv, "csv", false, "one table"},
    ExportFormatInfo{ExportFormat::kPly, "ply", true, "volumes of a recording"},
    ExportFormatInfo{ExportFormat::kMp4, "mp4", false, "images with the skeleton"},
    ExportFormatInfo{ExportFormat::kSession, "session", true, "anonymous session folder"}};

constexpr const ExportFormatInfo* find_export_format(std::string_view name) {
    for (const ExportFormatInfo& info : kExportFormats)
        if (info.name == name) return &info;
    return nullptr;
}
constexpr const ExportFormatInfo* find_export_format(ExportFormat format) {
    for (const ExportFormatInfo& info : kExportFormats)
        if (info.format == format) return &info;
    return nullptr;
}

// From `first` to `last`, both included.
struct FrameRange {
    std::int64_t first = 0;
    std::optional<std::int64_t> last;  // absent: to the end
};

// "30-89", or "30-" to the end; nothing where it is neither, or LAST < FIRST.
inline std::optional<FrameRange> parse_frame_range(std::string_view text) {
    constexpr std::int64_t kMaxFrame = 1'000'000'000'000'000;
    const auto parse_frame = [](std::string_view number) -> std::optional<std::int64_t> {
        std::int64_t frame = 0;
        const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), frame);
        if (error != std::errc{} || end != number.data() + number.size() || frame < 0 || frame > kMaxFrame)
            return std::nullopt;
        return frame;
    };
    const std::size_t dash = text.find('-');
    if (dash == std::string_view::npos) return std::nullopt;
    const auto first = parse_frame(text.substr(0, dash));
    if (!first) return std::nullopt;
    if (dash + 1 == text.size()) return FrameRange{*first, std::nullopt};
    const auto last = parse_frame(text.substr(dash + 1));
    if (!last || *last < *first) return std::nullopt;
    return FrameRange{*first, *last};
}

}  // namespace kinevox
