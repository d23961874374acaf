#include "server/recording/volume_file.h"

#include <fmt/format.h>

#include <cstring>
#include <fstream>
#include <span>
#include <system_error>
#include <utility>

#include "common/files.h"
#include "common/volume_codec.h"

namespace kinevox {
namespace {

constexpr std::string_view kHeader{"KVXVOLS\1", 8};
constexpr std::size_t kEntryHeader = 12;  // frame: 8 bytes, length: 4 bytes, little endian

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeFile>> VolumeFile::create(const std::filesystem::path& file) {
    auto made = AppendFile::create(file);
    if (!made.ok()) return made.status();
    std::unique_ptr<VolumeFile> volumes(new VolumeFile(*std::move(made)));
    if (absl::Status begun = volumes->file_.append(kHeader); !begun.ok()) return begun;
    return volumes;
}

absl::Status VolumeFile::append(std::uint64_t frame, std::string_view encoded) {
    std::string bytes;
    bytes.reserve(kEntryHeader + encoded.size());
    put_little_endian(bytes, frame);
    put_little_endian(bytes, static_cast<std::uint32_t>(encoded.size()));
    bytes += encoded;
    return file_.append(bytes);
}

absl::StatusOr<VolumeFileReader> VolumeFileReader::open(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    if (!in)
        return absl::NotFoundError(
            fmt::format("{}: there are no volumes; record with volumes = true", file.string()));
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(file, error);
    char header[kHeader.size()];
    if (error || !in.read(header, sizeof header) || std::string_view(header, sizeof header) != kHeader)
        return absl::InvalidArgumentError(fmt::format("{}: holds no volumes of this version", file.string()));
    VolumeFileReader reader;
    reader.file_ = file;
    std::uint64_t at = kHeader.size();
    char entry[kEntryHeader];
    while (at + kEntryHeader <= size && in.seekg(static_cast<std::streamoff>(at)).read(entry, sizeof entry)) {
        std::string_view numbers(entry, sizeof entry);
        const auto frame = take_little_endian<std::uint64_t>(numbers);
        const Entry found{frame, at + kEntryHeader, take_little_endian<std::uint32_t>(numbers)};
        at = found.offset + found.bytes;
        const bool rises = reader.entries_.empty() || found.frame > reader.entries_.back().frame;
        if (at > size || !rises) break;
        reader.entries_.push_back(found);
    }
    return reader;
}

absl::StatusOr<Volume> VolumeFileReader::read(const Entry& entry) const {
    std::ifstream in(file_, std::ios::binary);
    std::vector<std::uint8_t> bytes(entry.bytes);
    if (!in.seekg(static_cast<std::streamoff>(entry.offset))
             .read(reinterpret_cast<char*>(bytes.data()), entry.bytes))
        return absl::DataLossError(
            fmt::format("{}: the volume of frame {} cannot be read", file_.string(), entry.frame));
    auto volume = decode_volume(bytes);
    if (!volume.ok())
        return absl::DataLossError(fmt::format("{}: the volume of frame {}: {}", file_.string(), entry.frame,
                                               std::string(volume.status().message())));
    return volume;
}

}  // namespace kinevox
