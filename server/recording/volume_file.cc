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

constexpr std::string_view kMagic = "KVXVOLS";  // then the version, one byte

// Little endian: frame, 8 bytes; with subjects the subject's id, 4; length, 4.
std::size_t entry_header_bytes(VolumeFile::Version version) {
    return version == VolumeFile::Version::kFirst ? 12 : 16;
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeFile>> VolumeFile::create(const std::filesystem::path& file,
                                                               Version version) {
    auto made = AppendFile::create(file);
    if (!made.ok()) return made.status();
    std::unique_ptr<VolumeFile> volumes(new VolumeFile(*std::move(made), version));
    if (absl::Status begun = volumes->file_.append(std::string(kMagic) + static_cast<char>(version));
        !begun.ok())
        return begun;
    return volumes;
}

absl::Status VolumeFile::append(std::uint64_t frame, std::uint32_t subject_id, std::string_view encoded) {
    std::string bytes;
    bytes.reserve(entry_header_bytes(version_) + encoded.size());
    put_little_endian(bytes, frame);
    if (version_ == Version::kWithSubjects) put_little_endian(bytes, subject_id);
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
    char header[kMagic.size() + 1];
    const bool known = !error && in.read(header, sizeof header) &&
                       std::string_view(header, kMagic.size()) == kMagic &&
                       (header[kMagic.size()] == static_cast<char>(VolumeFile::Version::kFirst) ||
                        header[kMagic.size()] == static_cast<char>(VolumeFile::Version::kWithSubjects));
    if (!known)
        return absl::InvalidArgumentError(fmt::format("{}: holds no volumes of this version", file.string()));
    VolumeFileReader reader;
    reader.file_ = file;
    const auto version = static_cast<VolumeFile::Version>(header[kMagic.size()]);
    const std::size_t head = entry_header_bytes(version);
    std::uint64_t at = sizeof header;
    std::string entry(head, '\0');
    while (at + head <= size &&
           in.seekg(static_cast<std::streamoff>(at)).read(entry.data(), static_cast<std::streamsize>(head))) {
        std::string_view numbers = entry;
        Entry found;
        found.frame = take_little_endian<std::uint64_t>(numbers);
        if (version == VolumeFile::Version::kWithSubjects)
            found.subject_id = take_little_endian<std::uint32_t>(numbers);
        found.bytes = take_little_endian<std::uint32_t>(numbers);
        found.offset = at + head;
        at = found.offset + found.bytes;
        bool rises = true;
        if (!reader.entries_.empty()) {
            const Entry& before = reader.entries_.back();
            found.first_of_frame = found.frame != before.frame;
            rises = found.first_of_frame ? found.frame > before.frame : found.subject_id > before.subject_id;
        }
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
