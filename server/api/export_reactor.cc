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
#include "common/degrees.h"
#include "server/api/caller.h"
#include "server/api/recording_handlers.h"
#include "server/api/to_proto.h"
#include "server/recording/anonymous_session.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kPieceBytes = 512 << 10;
constexpr std::chrono::milliseconds kBetweenWords{250};
constexpr std::string_view kPrefix = ".export-";

// A hidden folder beside the recordings, where there is room for films; those of daemons that are gone are
// removed.
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
        return absl::UnavailableError(
            fmt::format("{}: the daemon cannot write there; correct its rights", recordings.string()));
    return fs::path(pattern);
}

absl::StatusOr<std::string> format_of(v1::ExportFormat format) {
    switch (format) {
        case v1::EXPORT_FORMAT_TRC:
            return "trc";
        case v1::EXPORT_FORMAT_MOT:
            return "mot";
        case v1::EXPORT_FORMAT_C3D:
            return "c3d";
        case v1::EXPORT_FORMAT_BVH:
            return "bvh";
        case v1::EXPORT_FORMAT_CSV:
            return "csv";
        case v1::EXPORT_FORMAT_PLY:
            return "ply";
        case v1::EXPORT_FORMAT_MP4:
            return "mp4";
        case v1::EXPORT_FORMAT_SESSION:
            return "session";
        default:
            return absl::InvalidArgumentError(
                fmt::format("format is {}, which this daemon does not know", static_cast<int>(format)));
    }
}

}  // namespace

ExportReactor* ExportReactor::run(const ApiContext& api, grpc::CallbackServerContext* context,
                                  const v1::ExportRequest& request) {
    std::shared_ptr<ExportReactor> reactor(new ExportReactor(api));
    reactor->self_ = reactor;
    if (const absl::Status missing = check_recording(api); !missing.ok())
        reactor->Finish(to_grpc(missing));
    else if (const absl::Status counted = reactor->be_counted(context); !counted.ok())
        reactor->Finish(to_grpc(counted));
    else
        boost::asio::post(api.exports, [reactor, request] { reactor->make(request); });
    return reactor.get();
}

absl::Status ExportReactor::be_counted(grpc::CallbackServerContext* context) {
    if (!api_.guard) return absl::OkStatus();
    auto counted =
        api_.guard->open_stream(authorization_of(*context), [weak = weak_from_this()](const absl::Status&) {
            if (const auto self = weak.lock()) self->revoked_ = self->stop_ = true;
        });
    if (counted.ok()) counted_ = *std::move(counted);
    return counted.status();
}

// The files go first: who has got the answer finds nothing left behind.
void ExportReactor::finish(const grpc::Status& status) {
    std::error_code ignored;
    if (!folder_.empty()) fs::remove_all(folder_, ignored);
    counted_.reset();
    Finish(revoked_ ? grpc::Status(grpc::StatusCode::UNAUTHENTICATED, "the token was revoked or has expired")
                    : status);
}

absl::StatusOr<ExportedFiles> ExportReactor::make_files(const v1::ExportRequest& request) {
    const auto format = format_of(request.format());
    if (!format.ok()) return format.status();
    const fs::path recordings = api_.recorder->options().folder;
    const auto session = recording_session_file(recordings, request.recording());
    if (!session.ok()) return session.status();
    if (request.first_frame() < 0 || request.width_px() < 0 || request.width_px() > 8192 ||
        !(std::abs(request.turn_deg()) <= 360))
        return absl::InvalidArgumentError(
            "first_frame must be 0 or more, width_px 0 to 8192, turn_deg -360 to 360");
    auto folder = make_folder(recordings);
    if (!folder.ok()) return folder.status();
    folder_ = *std::move(folder);
    ExportOptions options;
    options.format = *format;
    options.first_frame = request.first_frame();
    options.last_frame = request.last_frame() > 0 ? request.last_frame() : -1;
    options.turn_rad = radians(request.turn_deg());
    options.hold = request.hold();
    options.camera = request.camera();
    options.width_px = request.width_px();
    options.anonymous = request.anonymous();
    options.beside_capture = true;
    const bool many = *format == "ply" || *format == "session";
    const std::string name = request.anonymous() ? kAnonymous : request.recording();
    const fs::path out = many ? folder_ : folder_ / (name + "." + *format);
    LongWork work{stop_};
    if (request.progress()) work.progress = [this](double share) { tell(share); };
    return export_recording(*session, options, out, work);
}

void ExportReactor::make(const v1::ExportRequest& request) {
    lower_this_threads_priority();  // the thread does nothing else
    next_word_ = std::chrono::steady_clock::now() + kBetweenWords;
    made_ = make_files(request);
    if (writing_.exchange(Writing::kPieces) == Writing::kNothing) send_next();
}

// A client that reads slowly misses words.
void ExportReactor::tell(double share) {
    const auto now = std::chrono::steady_clock::now();
    Writing nothing = Writing::kNothing;
    if (now < next_word_ || !writing_.compare_exchange_strong(nothing, Writing::kWord)) return;
    next_word_ = now + kBetweenWords;
    piece_.Clear();
    piece_.set_done_share(share);
    StartWrite(&piece_);
}

void ExportReactor::send_next() {
    if (!made_.ok()) return finish(to_grpc(made_.status()));
    if (stop_ || at_ >= made_->files.size())
        return finish(stop_ ? grpc::Status::CANCELLED : grpc::Status::OK);
    const fs::path& path = made_->files[at_];
    if (!file_.is_open()) file_.open(path, std::ios::binary);
    piece_.Clear();
    piece_.set_file_name(path.filename().string());
    std::string& data = *piece_.mutable_data();
    data.resize(kPieceBytes);
    file_.read(data.data(), static_cast<std::streamsize>(data.size()));
    data.resize(static_cast<std::size_t>(file_.gcount()));
    if (file_.bad())
        return finish({grpc::StatusCode::DATA_LOSS, fmt::format("{}: cannot be read back", path.string())});
    if (file_.eof() || file_.peek() == std::ifstream::traits_type::eof()) {
        piece_.set_last_of_file(true);
        if (++at_ == made_->files.size()) piece_.set_remark(made_->remark);
        file_.close();
        file_.clear();
    }
    StartWrite(&piece_);
}

void ExportReactor::OnWriteDone(bool ok) {
    if (!ok) stop_ = true;
    Writing word = Writing::kWord;
    if (writing_.compare_exchange_strong(word, Writing::kNothing)) return;  // make() goes on
    boost::asio::post(api_.exports, [self = shared_from_this()] { self->send_next(); });
}

void ExportReactor::OnDone() {
    boost::asio::post(api_.exports,
                      [self = std::exchange(self_, nullptr)] {});  // a task of it may still run there
}

}  // namespace kinevox
