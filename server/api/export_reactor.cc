#include "server/api/export_reactor.h"

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/background_priority.h"
#include "common/export_options.h"
#include "common/geometry.h"
#include "server/api/call.h"
#include "server/api/recording_service.h"
#include "server/api/to_proto.h"
#include "server/recording/anonymous_export.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kChunkBytes = 512 << 10;
constexpr std::chrono::milliseconds kReportPeriod{250};
constexpr std::string_view kPrefix = ".export-";

// A hidden folder next to the recordings, on the disk with space for videos. Removes those of dead daemons.
absl::StatusOr<fs::path> make_folder(const fs::path& recordings) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(recordings, error)) {
        const std::string name = entry.path().filename().string();
        if (!name.starts_with(kPrefix)) continue;
        int owner = 0;
        std::from_chars(name.data() + kPrefix.size(), name.data() + name.size(), owner);
        std::error_code ignored;
        if (owner > 0 && ::kill(owner, 0) != 0 && errno == ESRCH) fs::remove_all(entry.path(), ignored);
    }
    std::string pattern = (recordings / fmt::format("{}{}-XXXXXX", kPrefix, getpid())).string();
    if (!::mkdtemp(pattern.data()))
        return absl::UnavailableError(fmt::format(
            "{}: not writable for the daemon; correct the folder's permissions", recordings.string()));
    return fs::path(pattern);
}

absl::StatusOr<ExportFormatInfo> format_of(v1::ExportFormat format) {
    if (const ExportFormatInfo* const info = find_export_format(static_cast<ExportFormat>(format)))
        return *info;
    return absl::InvalidArgumentError(fmt::format(
        "format {} is unknown; use TRC, MOT, C3D, BVH, CSV, PLY, MP4 or SESSION", static_cast<int>(format)));
}
static_assert(static_cast<int>(ExportFormat::kSession) == static_cast<int>(v1::EXPORT_FORMAT_SESSION));

absl::Status check(const v1::ExportRecordingRequest& request) {
    if (request.first_frame() < 0)
        return absl::InvalidArgumentError(
            fmt::format("first_frame is {}; frames count from 0", request.first_frame()));
    if (request.has_last_frame() && request.last_frame() < request.first_frame())
        return absl::InvalidArgumentError(
            fmt::format("last_frame is {}, before first_frame {}; omit it to export to the end",
                        request.last_frame(), request.first_frame()));
    if (request.width_px() < 0 || request.width_px() > 8192)
        return absl::InvalidArgumentError(
            fmt::format("width_px is {}; 1 to 8192 are allowed, or 0 for the default", request.width_px()));
    if (!(std::abs(request.yaw_deg()) <= 360))
        return absl::InvalidArgumentError(
            fmt::format("yaw_deg is {}; -360 to 360 are allowed", request.yaw_deg()));
    return absl::OkStatus();
}

}  // namespace

ExportReactor* ExportReactor::run(const ApiContext& api, grpc::CallbackServerContext* context,
                                  const v1::ExportRecordingRequest& request) {
    std::shared_ptr<ExportReactor> reactor(new ExportReactor(api));
    reactor->self_ = reactor;
    if (const absl::Status missing = check_recording(api); !missing.ok())
        reactor->Finish(to_grpc(missing));
    else if (const absl::Status counted = reactor->register_stream(context); !counted.ok())
        reactor->Finish(to_grpc(counted));
    else
        boost::asio::post(api.threads.exports, [reactor, request] { reactor->create_files(request); });
    return reactor.get();
}

absl::Status ExportReactor::register_stream(grpc::CallbackServerContext* context) {
    if (!api_.guard) return absl::OkStatus();
    auto counted =
        api_.guard->open_stream(authorization_of(*context), [weak = weak_from_this()](const absl::Status&) {
            if (const auto self = weak.lock()) self->revoked_ = self->stop_ = true;
        });
    if (!counted.ok()) return counted.status();
    counted_ = *std::move(counted);
    return absl::OkStatus();
}

// Removes the files first, so that they are gone when the client receives the status.
void ExportReactor::finish(const grpc::Status& status) {
    std::error_code ignored;
    if (!folder_.empty()) fs::remove_all(folder_, ignored);
    counted_.reset();
    Finish(revoked_ ? grpc::Status(grpc::StatusCode::UNAUTHENTICATED, "the token was revoked or has expired")
                    : status);
}

absl::StatusOr<ExportedFiles> ExportReactor::files_of(const v1::ExportRecordingRequest& request) {
    const auto format = format_of(request.format());
    if (!format.ok()) return format.status();
    const fs::path recordings = api_.recorder->options().folder;
    const auto session = recording_session_file(recordings, request.name());
    if (!session.ok()) return session.status();
    if (absl::Status bad = check(request); !bad.ok()) return bad;
    auto folder = make_folder(recordings);
    if (!folder.ok()) return folder.status();
    folder_ = *std::move(folder);
    ExportOptions options;
    options.format = format->format;
    options.first_frame = request.first_frame();
    if (request.has_last_frame()) options.last_frame = request.last_frame();
    options.subject_id = request.subject_id();
    options.yaw_rad = radians(request.yaw_deg());
    options.hold_withheld = request.hold_withheld();
    options.camera = request.camera();
    options.width_px = request.width_px();
    options.anonymous = request.anonymous();
    options.low_priority = true;
    const std::string name = request.anonymous() ? kAnonymous : request.name();
    const fs::path out = format->many_files ? folder_ : folder_ / fmt::format("{}.{}", name, format->name);
    JobControl work{stop_};
    if (request.report_progress()) work.progress = [this](double progress) { report(progress); };
    return export_recording(*session, options, out, work);
}

void ExportReactor::create_files(const v1::ExportRecordingRequest& request) {
    lower_this_threads_priority();  // it runs exports only
    next_report_ = std::chrono::steady_clock::now() + kReportPeriod;
    files_ = files_of(request);
    if (writing_.exchange(Writing::kChunks) == Writing::kNothing) send_next();
}

// A slow client misses progress messages.
void ExportReactor::report(double progress) {
    const auto now = std::chrono::steady_clock::now();
    Writing nothing = Writing::kNothing;
    if (now < next_report_ || !writing_.compare_exchange_strong(nothing, Writing::kProgress)) return;
    next_report_ = now + kReportPeriod;
    chunk_.Clear();
    chunk_.set_progress(progress);
    StartWrite(&chunk_);
}

void ExportReactor::send_next() {
    if (!files_.ok()) return finish(to_grpc(files_.status()));
    if (stop_ || file_index_ >= files_->files.size())
        return finish(stop_ ? grpc::Status::CANCELLED : grpc::Status::OK);
    const fs::path& path = files_->files[file_index_];
    if (!file_.is_open()) file_.open(path, std::ios::binary);
    chunk_.Clear();
    chunk_.set_file_name(path.filename().string());
    std::string& data = *chunk_.mutable_data();
    data.resize(kChunkBytes);
    file_.read(data.data(), static_cast<std::streamsize>(data.size()));
    data.resize(static_cast<std::size_t>(file_.gcount()));
    if (file_.bad())
        return finish(
            {grpc::StatusCode::DATA_LOSS, fmt::format("{}: cannot be read; export again", path.string())});
    if (file_.eof() || file_.peek() == std::ifstream::traits_type::eof()) {
        chunk_.set_last_chunk(true);
        if (++file_index_ == files_->files.size()) chunk_.set_warning(files_->warning);
        file_.close();
        file_.clear();
    }
    StartWrite(&chunk_);
}

void ExportReactor::OnWriteDone(bool ok) {
    if (!ok) stop_ = true;
    Writing progress = Writing::kProgress;
    if (writing_.compare_exchange_strong(progress, Writing::kNothing)) return;  // create_files() continues
    boost::asio::post(api_.threads.exports, [self = shared_from_this()] { self->send_next(); });
}

void ExportReactor::OnDone() {
    boost::asio::post(api_.threads.exports,
                      [self = std::exchange(self_, nullptr)] {});  // a task of it may still be running there
}

}  // namespace kinevox
