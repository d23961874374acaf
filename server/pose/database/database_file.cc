// Layout, little endian: "KVXPOSES", version (u32), 0 (u32), size of what follows the header (u64), checksum
// of it (u64), then the fields in the order of write_fields().
#include "server/pose/database/database_file.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>

#include "common/files.h"

namespace kinevox {
namespace {

static_assert(std::endian::native == std::endian::little, "the file has the memory layout");

constexpr char kMagic[8] = {'K', 'V', 'X', 'P', 'O', 'S', 'E', 'S'};
constexpr std::uint32_t kVersion = 2;
constexpr std::size_t kHeaderBytes = 32, kMaxBytes = std::size_t{4} << 30;

// Eight bytes at a time in four chains: detects damage at several GB/s.
std::uint64_t checksum(std::string_view bytes) {
    constexpr std::uint64_t kPrime = 0x9E3779B97F4A7C15ull;
    std::uint64_t chain[4] = {1, 2, 3, 4};
    std::size_t at = 0;
    for (; at + 32 <= bytes.size(); at += 32) {
        std::uint64_t words[4];
        std::memcpy(words, bytes.data() + at, 32);
        for (int n = 0; n < 4; ++n) chain[n] = std::rotl((chain[n] ^ words[n]) * kPrime, 29);
    }
    std::uint64_t sum = bytes.size();
    for (; at < bytes.size(); ++at) sum = (sum ^ static_cast<unsigned char>(bytes[at])) * kPrime;
    for (const std::uint64_t value : chain) sum = std::rotl((sum ^ value) * kPrime, 31);
    return sum ^ (sum >> 29);
}

class Writer {
  public:
    template <class T>
    void number(T value) {
        bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    void text(std::string_view text) {
        number(static_cast<std::uint64_t>(text.size()));
        bytes_.append(text);
    }
    template <class T>
    void list(const std::vector<T>& list) {
        static_assert(std::is_trivially_copyable_v<T>);
        number(static_cast<std::uint64_t>(list.size()));
        bytes_.append(reinterpret_cast<const char*>(list.data()), list.size() * sizeof(T));
    }
    std::string take() { return std::move(bytes_); }

  private:
    std::string bytes_;
};

// After a failure all reads return empty values and ok() is false.
class Reader {
  public:
    explicit Reader(std::string_view bytes) : rest_(bytes) {}
    bool ok() const { return ok_; }
    bool at_end() const { return ok_ && rest_.empty(); }
    void fail() { ok_ = false, rest_ = {}; }

    template <class T>
    T number() {
        T value{};
        if (rest_.size() < sizeof value) {
            fail();
            return value;
        }
        std::memcpy(&value, rest_.data(), sizeof value);
        rest_.remove_prefix(sizeof value);
        return value;
    }
    std::uint64_t count(std::uint64_t bytes_each) {
        const auto n = number<std::uint64_t>();
        if (n > rest_.size() / bytes_each) {
            fail();
            return 0;
        }
        return n;
    }
    std::string text() {
        const std::size_t n = count(1);
        std::string out(rest_.substr(0, n));
        rest_.remove_prefix(n);
        return out;
    }
    template <class T>
    void list(std::vector<T>& out) {
        const std::size_t n = count(sizeof(T));
        out.resize(n);
        if (n > 0) std::memcpy(out.data(), rest_.data(), n * sizeof(T));
        rest_.remove_prefix(n * sizeof(T));
    }

  private:
    std::string_view rest_;
    bool ok_ = true;
};

void write_fields(const PoseDatabase& database, Writer& out) {
    const PoseDatabaseOptions& o = database.options;
    out.text(database.fingerprint);
    out.number(o.poses), out.number(o.order), out.number(o.side_px);
    out.number(o.half_width_per_stature), out.number(o.elevation_step_deg),
        out.number(o.inverse_distance_step);
    out.number(database.shape.stature_m);
    for (const double length : database.shape.lengths_m) out.number(length);
    out.number(static_cast<std::uint64_t>(database.poses.size()));
    for (const LibraryPose& pose : database.poses) {
        out.text(pose.label);
        out.number(static_cast<std::uint8_t>(pose.user_defined));
        for (const double value : pose.coordinates) out.number(value);
    }
    out.number(static_cast<std::uint64_t>(database.removed.size()));
    for (const std::string& label : database.removed) out.text(label);
    out.list(database.body_centres);
    out.list(database.viewpoints);
    out.number(database.moment_step), out.number(database.code_step);
    out.list(database.code_basis);
    out.list(database.code_mean);
    for (const PoseDatabase::Slab& slab : database.slabs) {
        out.list(slab.moments);
        out.list(slab.centres);
        out.list(slab.codes);
        for (const std::string& silhouettes : slab.silhouettes) out.text(silhouettes);
    }
}

bool read_fields(Reader& in, PoseDatabase& database, const std::stop_token& stop) {
    PoseDatabaseOptions& o = database.options;
    database.fingerprint = in.text();
    o.poses = in.number<int>(), o.order = in.number<int>(), o.side_px = in.number<int>();
    o.half_width_per_stature = in.number<double>(), o.elevation_step_deg = in.number<double>();
    o.inverse_distance_step = in.number<double>();
    database.shape.stature_m = in.number<double>();
    for (double& length : database.shape.lengths_m) length = in.number<double>();
    const std::uint64_t poses = in.count(sizeof(BodyCoordinates));
    for (std::uint64_t n = 0; n < poses && in.ok(); ++n) {
        LibraryPose& pose = database.poses.emplace_back();
        pose.label = in.text();
        pose.user_defined = in.number<std::uint8_t>() != 0;
        for (double& value : pose.coordinates) value = in.number<double>();
    }
    const std::uint64_t removed = in.count(sizeof(std::uint64_t));
    for (std::uint64_t n = 0; n < removed && in.ok(); ++n) database.removed.push_back(in.text());
    in.list(database.body_centres);
    in.list(database.viewpoints);
    database.moment_step = in.number<float>(), database.code_step = in.number<float>();
    in.list(database.code_basis);
    in.list(database.code_mean);
    if (!in.ok() || !o.check().empty() || !(database.code_step > 0) || !(database.shape.stature_m > 0))
        return false;
    const std::size_t views = poses * kernels::kViewBins,
                      values = static_cast<std::size_t>(database.values());
    if (database.body_centres.size() != poses || database.code_basis.size() != kernels::kCodeBytes * values ||
        database.code_mean.size() != kernels::kCodeBytes || database.viewpoints.empty())
        return false;
    for (std::size_t n = 0; n < database.viewpoints.size() && in.ok(); ++n) {
        if (stop.stop_requested()) return false;
        PoseDatabase::Slab& slab = database.slabs.emplace_back();
        in.list(slab.moments);
        in.list(slab.centres);
        in.list(slab.codes);
        for (std::uint64_t pose = 0; pose < poses && in.ok(); ++pose) slab.silhouettes.push_back(in.text());
        if (!in.ok() || slab.moments.size() != views * values || slab.centres.size() != 2 * views ||
            slab.codes.size() != views * kernels::kCodeBytes)
            return false;
        for (const std::uint8_t byte : slab.codes)
            if (byte > kernels::kCodeMax) return false;
        slab.search = kernels::MomentSlab::make(slab.codes);
    }
    return in.at_end();
}

}  // namespace

absl::Status write_pose_database(const PoseDatabase& database, const std::filesystem::path& file) {
    Writer body;
    write_fields(database, body);
    const std::string fields = body.take();
    return write_file_atomically(file, pose_database_header(fields) + fields);
}

std::string pose_database_header(std::string_view fields) {
    Writer out;
    for (const char letter : kMagic) out.number(letter);
    out.number(kVersion), out.number(std::uint32_t{0});
    out.number(static_cast<std::uint64_t>(fields.size())), out.number(checksum(fields));
    return out.take();
}

absl::StatusOr<PoseDatabase> parse_pose_database(std::string_view bytes, const std::string& name,
                                                 std::stop_token stop) {
    const auto damaged = [&](const char* why) {
        return absl::DataLossError(fmt::format("{}: {}; it will be rebuilt, or delete it", name, why));
    };
    if (bytes.size() < kHeaderBytes || std::memcmp(bytes.data(), kMagic, sizeof kMagic) != 0)
        return damaged("is not a pose database");
    Reader header(bytes.substr(sizeof kMagic, kHeaderBytes - sizeof kMagic));
    const auto version = header.number<std::uint32_t>();
    header.number<std::uint32_t>();
    const auto size = header.number<std::uint64_t>(), sum = header.number<std::uint64_t>();
    if (version != kVersion)
        return absl::FailedPreconditionError(
            fmt::format("{}: has version {}, this program writes {}; it will be rebuilt, or delete it", name,
                        version, kVersion));
    const std::string_view fields = bytes.substr(kHeaderBytes);
    if (fields.size() != size) return damaged("is truncated or too long");
    if (checksum(fields) != sum) return damaged("is damaged: wrong checksum");
    PoseDatabase database;
    Reader in(fields);
    if (!read_fields(in, database, stop)) {
        if (stop.stop_requested()) return absl::CancelledError("reading the pose database was cancelled");
        return damaged("is inconsistent");
    }
    return database;
}

absl::StatusOr<PoseDatabase> read_pose_database(const std::filesystem::path& file, std::stop_token stop) {
    auto bytes = read_file(file, kMaxBytes);
    if (!bytes.ok()) return bytes.status();
    return parse_pose_database(*bytes, file.string(), std::move(stop));
}

absl::StatusOr<OpenedDatabase> open_pose_database(const std::filesystem::path& file,
                                                  std::span<const kernels::CameraModel> cameras,
                                                  const BodyShape& shape, const PoseDatabaseOptions& options,
                                                  const BuildProgress& progress, std::stop_token stop) {
    OpenedDatabase opened;
    UserChanges changes;
    absl::StatusOr<PoseDatabase> read = read_pose_database(file, stop);
    if (absl::IsCancelled(read.status())) return read.status();
    if (read.ok()) {
        std::string wanted;
        try {
            wanted = database_fingerprint(cameras, shape, options);
        } catch (const std::invalid_argument& error) {
            return absl::InvalidArgumentError(error.what());
        }
        if (read->fingerprint == wanted) {
            opened.database = *std::move(read);
            return opened;
        }
        changes = user_changes(*read);
        opened.rebuilt_because = fmt::format(
            "{}: was built for other cameras, another body or other options; rebuilt", file.string());
    } else if (absl::IsNotFound(read.status())) {
        opened.rebuilt_because = fmt::format("{}: did not exist; built", file.string());
    } else {
        opened.rebuilt_because =
            fmt::format("{} (poses that were added to it are lost)", std::string(read.status().message()));
    }
    auto built = build_pose_database(cameras, shape, options, changes, progress, stop);
    if (!built.ok()) return built.status();
    // Writing takes time, too; the next start builds the file if it is missing.
    if (stop.stop_requested()) return absl::CancelledError("writing the pose database was cancelled");
    opened.database = *std::move(built);
    if (const absl::Status written = write_pose_database(opened.database, file); !written.ok())
        opened.rebuilt_because += "; " + std::string(written.message());
    return opened;
}

}  // namespace kinevox
