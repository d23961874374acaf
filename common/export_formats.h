// The export formats of `kinevox export`, `kinevox record export` and the API: a new one is added here, with
// its writer in server/recording/recording_export.cc.
#pragma once

#include <array>
#include <string_view>

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

}  // namespace kinevox
