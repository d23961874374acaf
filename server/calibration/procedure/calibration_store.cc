#include "server/calibration/procedure/calibration_store.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <nlohmann/json.hpp>

#include "common/bin.h"
#include "common/calibration_file.h"
#include "common/files.h"
#include "server/calibration/certificate/certificate.h"
#include "server/calibration/exact_integer.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kCalibration = "calibration.toml";
constexpr const char* kCertificate = "certificate.json";
constexpr const char* kPage = "certificate.png";
constexpr const char* kEntry = "calibration.json";
constexpr const char* kActive = "active.json";

// 0 if it is not an id.
int number_of(std::string_view id) {
    int number = 0;
    if (id.size() < 2 || id.size() > 8 || id[0] != 'c' || id[1] == '0') return 0;
    const auto [end, error] = std::from_chars(id.data() + 1, id.data() + id.size(), number);
    return error == std::errc() && end == id.data() + id.size() ? number : 0;
}

// FNV-1a: identifies a text; not cryptographic.
std::string digest(const std::string& text) {
    std::uint64_t hash = 14695981039346656037ull;
    for (const unsigned char c : text) hash = (hash ^ c) * 1099511628211ull;
    return fmt::format("{:016x}", hash);
}

std::optional<Verdict> stored_verdict(const std::string& text) {
    for (const Verdict verdict : {Verdict::kGo, Verdict::kCaution, Verdict::kNoGo})
        if (text == to_text(verdict)) return verdict;
    return std::nullopt;
}

Json parsed(const absl::StatusOr<std::string>& text) {
    return text.ok() ? Json::parse(*text, nullptr, false) : Json(Json::value_t::discarded);
}

std::vector<std::string> strings(const Json& array) {
    std::vector<std::string> out;
    if (array.is_array())
        for (const Json& one : array)
            if (one.is_string()) out.push_back(one.get<std::string>());
    return out;
}

// 0 if there is none.
template <std::integral T>
T exact_integer_at(const Json& object, const char* key) {
    const auto found = object.find(key);
    if (found == object.end()) return 0;
    if (const auto number = exact_integer<T>(*found)) return *number;
    throw std::invalid_argument(fmt::format("{} is not an integer", key));
}

std::vector<int> numbers_in(const fs::path& folder) {
    std::vector<int> numbers;
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder, error))
        if (const int number = number_of(entry.path().filename().string()); number > 0)
            numbers.push_back(number);
    std::ranges::sort(numbers);
    return numbers;
}

// Removes what was deleted more than kBinDays ago.
void empty_bin(const fs::path& bin) {
    const auto oldest =
        fs::file_time_type::clock::now() - std::chrono::hours(static_cast<int>(24 * kBinDays));
    std::error_code error;
    for (const int number : numbers_in(bin)) {
        const fs::path entry = bin / fmt::format("c{}", number);
        if (const auto deleted = fs::last_write_time(entry, error); !error && deleted < oldest)
            fs::remove_all(entry, error);
    }
}

}  // namespace

CalibrationStore::CalibrationStore(fs::path folder, std::string source, std::vector<Camera> own_cameras)
    : folder_(std::move(folder)),
      key_(source + " " + digest(calibration_toml(own_cameras))),
      own_(std::move(own_cameras)) {}

absl::Status CalibrationStore::check_folder() const {
    if (!folder_.empty()) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon stores no calibrations; give [calibration] folder in its configuration");
}

fs::path CalibrationStore::folder_of(const std::string& id) const {
    return folder_ / id;
}

absl::StatusOr<CalibrationListing> CalibrationStore::read_entry(const std::string& id) const {
    const auto missing = [&] {
        return absl::NotFoundError(
            fmt::format("calibration '{}' does not exist; list the stored ones", id.substr(0, 40)));
    };
    if (number_of(id) == 0) return missing();
    const Json entry = parsed(read_file(folder_of(id) / kEntry));
    if (!entry.is_object()) return missing();
    CalibrationListing out;
    out.id = id;
    std::size_t fitting = 0;
    try {
        out.time_utc_ns = exact_integer_at<std::int64_t>(entry, "create_time_utc_ns");
        out.method = entry.value("method", "");
        out.note = entry.value("note", "");
        out.verdict = stored_verdict(entry.value("verdict", ""));
        for (const Json& camera : entry.value("cameras", Json::array())) {
            const std::string name = camera.value("name", "");
            out.cameras.push_back(name);
            const Camera* const own = camera_named(own_, name);
            const int width = exact_integer_at<int>(camera, "width"),
                      height = exact_integer_at<int>(camera, "height");
            fitting += own && own->width == width && own->height == height;
        }
    } catch (const std::exception&) {  // including nlohmann's
        return absl::DataLossError(
            fmt::format("{}: damaged; delete the folder", (folder_of(id) / kEntry).string()));
    }
    out.compatible = fitting == own_.size();
    return out;
}

absl::StatusOr<std::vector<CalibrationListing>> CalibrationStore::list() const {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    std::vector<CalibrationListing> out;
    for (const int number : numbers_in(folder_))
        if (auto entry = read_entry(fmt::format("c{}", number)); entry.ok()) out.push_back(*std::move(entry));
    return out;
}

absl::StatusOr<std::string> CalibrationStore::add(const std::vector<Camera>& cameras,
                                                  const std::string& certificate_json,
                                                  const std::string& method, std::optional<Verdict> verdict,
                                                  const std::string& note, std::int64_t time_utc_ns) {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    const std::scoped_lock lock(mutex_);
    const std::vector<int> numbers = numbers_in(folder_);
    if (numbers.size() >= kMaxCalibrations)
        return absl::ResourceExhaustedError(
            fmt::format("{} calibrations are stored, the maximum; delete some", numbers.size()));
    Json entry{{"create_time_utc_ns", time_utc_ns}, {"method", method}, {"note", note}};
    if (verdict) entry["verdict"] = to_text(*verdict);
    entry["cameras"] = Json::array();
    for (const Camera& camera : cameras)
        entry["cameras"].push_back(
            {{"name", camera.name}, {"width", camera.width}, {"height", camera.height}});
    // Atomically: the folder is renamed when it is complete.
    const fs::path staging = folder_ / fmt::format(".new-{}", getpid());
    std::error_code error;
    fs::remove_all(staging, error);
    absl::Status written = write_calibration_toml(cameras, staging / kCalibration);
    if (written.ok()) written = write_file_atomically(staging / kCertificate, certificate_json);
    if (written.ok())
        written = write_file_atomically(staging / kEntry,
                                        entry.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
    std::string id;
    // An id in the bin is not used again, so that it can be restored.
    const std::vector<int> deleted = numbers_in(folder_ / kBinFolder);
    const int last = std::max(numbers.empty() ? 0 : numbers.back(), deleted.empty() ? 0 : deleted.back());
    for (int number = last + 1; written.ok() && id.empty(); ++number) {
        id = fmt::format("c{}", number);
        fs::rename(staging, folder_of(id), error);
        if (!error) continue;
        const bool taken = fs::exists(folder_of(id));  // by another daemon, just now
        if (!taken)
            written = absl::UnavailableError(fmt::format("{}: the calibration cannot be stored ({})",
                                                         folder_of(id).string(), error.message()));
        id.clear();
    }
    if (written.ok()) return id;
    fs::remove_all(staging, error);
    return absl::UnavailableError(std::string(written.message()));
}

absl::Status CalibrationStore::remove(const std::string& id) {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    const std::scoped_lock lock(mutex_);
    if (const auto entry = read_entry(id); !entry.ok()) return entry.status();
    const Json all = parsed(read_file(folder_ / kActive));
    if (all.is_object())
        for (const auto& [key, ids] : all.items())
            if (const auto applied = strings(ids); std::ranges::find(applied, id) != applied.end())
                return absl::FailedPreconditionError(fmt::format(
                    "calibration {} is active, or an undo would return to it; undo or apply another first",
                    id));
    const fs::path bin = folder_ / kBinFolder;
    std::error_code error;
    empty_bin(bin);
    fs::remove_all(bin / id, error);
    fs::create_directories(bin, error);
    if (!error) fs::rename(folder_of(id), bin / id, error);
    if (error)
        return absl::UnavailableError(
            fmt::format("{}: cannot be deleted ({})", folder_of(id).string(), error.message()));
    fs::last_write_time(bin / id, fs::file_time_type::clock::now(), error);  // when it was deleted
    return absl::OkStatus();
}

absl::StatusOr<std::vector<Camera>> CalibrationStore::cameras(const std::string& id) const {
    if (id.empty()) return own_;
    if (absl::Status there = check_folder(); !there.ok()) return there;
    if (const auto entry = read_entry(id); !entry.ok()) return entry.status();
    return read_calibration(folder_of(id) / kCalibration);
}

std::filesystem::path CalibrationStore::calibration_file(const std::string& id) const {
    return folder_of(id) / kCalibration;
}

absl::StatusOr<std::string> CalibrationStore::certificate_json(const std::string& id) const {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    if (const auto entry = read_entry(id); !entry.ok()) return entry.status();
    return read_file(folder_of(id) / kCertificate);
}

absl::StatusOr<std::string> CalibrationStore::certificate_page(const std::string& id) const {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    if (const auto entry = read_entry(id); !entry.ok()) return entry.status();
    const fs::path page = folder_of(id) / kPage;
    std::error_code error;
    if (!fs::exists(page, error))
        if (const absl::Status drawn = draw_report_page(folder_of(id) / kCertificate, page); !drawn.ok())
            return absl::UnavailableError(drawn.message());
    return read_file(page);
}

absl::StatusOr<CalibrationListing> CalibrationStore::find(const std::string& id) const {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    return read_entry(id);
}

absl::StatusOr<std::vector<Camera>> CalibrationStore::compatible_cameras(const std::string& id) const {
    const auto all = cameras(id);
    if (!all.ok()) return all.status();
    std::vector<Camera> out;
    for (const Camera& own : own_) {
        const Camera* const found = camera_named(*all, own.name);
        if (!found)
            return absl::FailedPreconditionError(
                fmt::format("calibration {} has no camera {}; calibrate all cameras together", id, own.name));
        if (found->width != own.width || found->height != own.height)
            return absl::FailedPreconditionError(fmt::format(
                "calibration {} has camera {} at {} x {} px, its images are {} x {}; calibrate at that size",
                id, own.name, found->width, found->height, own.width, own.height));
        out.push_back(*found);
    }
    return out;
}

std::vector<std::string> CalibrationStore::read_applied() const {
    if (folder_.empty()) return {};
    const Json all = parsed(read_file(folder_ / kActive));
    return all.is_object() && all.contains(key_) ? strings(all[key_]) : std::vector<std::string>();
}

absl::Status CalibrationStore::write_applied(const std::vector<std::string>& ids) const {
    const fs::path file = folder_ / kActive;
    Json all = parsed(read_file(file));
    if (!all.is_object()) all = Json::object();
    if (ids.empty())
        all.erase(key_);
    else
        all[key_] = ids;
    return write_file_atomically(file, all.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::vector<std::string> CalibrationStore::applied() const {
    const std::scoped_lock lock(mutex_);
    return read_applied();
}

std::string CalibrationStore::active() const {
    const auto ids = applied();
    return ids.empty() ? "" : ids.back();
}

absl::Status CalibrationStore::apply(const std::string& id) {
    if (const auto fitting = compatible_cameras(id); !fitting.ok()) return fitting.status();
    const std::scoped_lock lock(mutex_);
    std::vector<std::string> ids = read_applied();
    if (!ids.empty() && ids.back() == id) return absl::OkStatus();
    ids.push_back(id);
    if (ids.size() > kMaxUndos) ids.erase(ids.begin());
    return write_applied(ids);
}

absl::StatusOr<std::string> CalibrationStore::undo() {
    if (absl::Status there = check_folder(); !there.ok()) return there;
    const std::scoped_lock lock(mutex_);
    std::vector<std::string> ids = read_applied();
    if (ids.empty())
        return absl::FailedPreconditionError(
            "the source's own calibration is active; there is nothing to undo");
    ids.pop_back();
    if (absl::Status written = write_applied(ids); !written.ok()) return written;
    return ids.empty() ? "" : ids.back();
}

}  // namespace kinevox
