#include "server/access/guard.h"

#include <absl/strings/match.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "server/access/audit_log.h"
#include "server/access/call_table.h"
#include "server/access/token_file.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;
using Tokens = std::vector<Token>;

std::int64_t now_s() {
    return std::chrono::duration_cast<std::chrono::seconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
}

// What changes when a file is replaced or written.
struct Stamp {
    std::uint64_t inode = 0;
    std::int64_t bytes = 0, time_s = 0, time_ns = 0, mode = 0;
    bool operator==(const Stamp&) const = default;
};

Stamp stamp_of(const std::filesystem::path& file) {
    struct stat found {};
    if (::stat(file.c_str(), &found) != 0) return {};
    return {found.st_ino, found.st_size, found.st_mtim.tv_sec, found.st_mtim.tv_nsec, found.st_mode};
}

// "/kinevox.v1.CaptureService/StartCapture" -> "CaptureService.StartCapture".
std::string short_name(std::string_view path) {
    if (path.starts_with('/')) path.remove_prefix(1);
    if (path.starts_with("kinevox.v1.")) path.remove_prefix(11);
    std::string name(path.substr(0, 200));
    std::ranges::replace(name, '/', '.');
    return name;
}

// Token bucket with a burst of one second.
struct Bucket {
    double level = 0;
    Clock::time_point at{};
    bool take(double per_s, Clock::time_point now) {
        const double elapsed =
            at == Clock::time_point{} ? 1 : std::chrono::duration<double>(now - at).count();
        level = std::min(std::max(per_s, 1.0), level + elapsed * per_s);
        at = now;
        if (level < 1) return false;
        level -= 1;
        return true;
    }
};

constexpr const char* kGone = "the token was revoked or has expired; get a new one from the administrator";

}  // namespace

struct Guard::Parts {
    std::filesystem::path file;
    AccessLimits limits;
    AuditLog* audit = nullptr;
    std::shared_ptr<const CallTable> calls = std::make_shared<CallTable>(std::vector<std::string>{});

    mutable std::mutex mutex;
    std::shared_ptr<const Tokens> tokens = std::make_shared<Tokens>();
    Stamp stamp;                            // tick()'s and create()'s
    std::map<std::string, Bucket> buckets;  // by the token's digest

    mutable std::mutex streams_mutex;
    std::set<Stream*> streams;
    std::map<std::string, int> streams_of;  // by the token's digest

    std::shared_ptr<const Tokens> current() const {
        const std::scoped_lock lock(mutex);
        return tokens;
    }

    absl::Status read() {
        const Stamp now = stamp_of(file);  // before reading, so that later changes are noticed
        auto read = read_tokens(file);
        const std::scoped_lock lock(mutex);
        stamp = now;
        tokens = std::make_shared<const Tokens>(read.ok() ? *std::move(read) : Tokens());
        std::erase_if(buckets, [&](const auto& bucket) {
            return std::ranges::none_of(
                *tokens, [&](const Token& token) { return to_hex(token.digest) == bucket.first; });
        });
        return read.status();
    }

    bool take(const std::string& digest) {
        const std::scoped_lock lock(mutex);
        return buckets[digest].take(limits.max_requests_per_s, Clock::now());
    }

    void refused(const std::string& caller, const std::string& role, std::string_view path,
                 const absl::Status& why) const {
        if (!audit) return;
        audit->add_refused({caller, role, "", short_name(path), absl::StatusCodeToString(why.code()),
                            std::string(why.message()), ""});
    }
};

Guard::Guard(std::shared_ptr<Parts> parts) : parts_(std::move(parts)) {}
Guard::~Guard() = default;

absl::StatusOr<std::unique_ptr<Guard>> Guard::create(const std::filesystem::path& tokens,
                                                     const AccessLimits& limits, AuditLog* audit) {
    auto parts = std::make_shared<Parts>();
    parts->file = tokens;
    parts->limits = limits;
    parts->audit = audit;
    if (!tokens.empty())
        if (const absl::Status read = parts->read(); !read.ok()) return read;
    return std::unique_ptr<Guard>(new Guard(std::move(parts)));
}

bool Guard::open() const {
    return parts_->file.empty();
}
AuditLog* Guard::audit() const {
    return parts_->audit;
}
void Guard::set_services(const std::vector<std::string>& names) {
    parts_->calls = std::make_shared<CallTable>(names);
}
const CallTable& Guard::calls() const {
    return *parts_->calls;
}

absl::StatusOr<Caller> Guard::identify(std::string_view authorization) const {
    if (open()) return Caller{};
    constexpr std::string_view kScheme = "Bearer ";
    if (authorization.empty())
        return absl::UnauthenticatedError("this daemon requires a token; give one (docs/access.md)");
    const std::string_view scheme = authorization.substr(0, kScheme.size());
    if (!absl::EqualsIgnoreCase({scheme.data(), scheme.size()}, {kScheme.data(), kScheme.size()}))
        return absl::UnauthenticatedError(
            "the authorization header has no bearer token; send 'Bearer ' and the token");
    const Digest digest = sha256(authorization.substr(kScheme.size()));
    const auto tokens = parts_->current();
    const Token* found = nullptr;
    for (const Token& token : *tokens)  // all of them: constant time
        if (same(token.digest, digest)) found = &token;
    if (!found) return absl::UnauthenticatedError("unknown token; get a new one from the administrator");
    if (!found->valid(now_s())) return absl::UnauthenticatedError(kGone);
    return Caller{found->name, found->role, to_hex(digest)};
}

absl::Status Guard::admit(std::string_view path, std::string_view authorization) {
    const auto caller = identify(authorization);
    if (!caller.ok()) {
        parts_->refused("", "", path, caller.status());
        return caller.status();
    }
    if (open()) return absl::OkStatus();
    const auto refuse = [&](const absl::Status& why) {
        parts_->refused(caller->name, name_of(caller->role), path, why);
        return why;
    };
    if (!parts_->take(caller->digest))
        return refuse(absl::ResourceExhaustedError(fmt::format(
            "{} sends more than {} requests per second; wait, or raise [server.limits] max_requests_per_s",
            caller->name, parts_->limits.max_requests_per_s)));
    const CallTable::Call* call = parts_->calls->find(path);
    if (!call) return absl::UnimplementedError("unknown method; the daemon may be older than the client");
    if (!has(caller->role, call->permission))
        return refuse(absl::PermissionDeniedError(
            fmt::format("{} requires one of the roles {}; the token {} has {}", short_name(path),
                        roles_with(call->permission), caller->name, name_of(caller->role))));
    return absl::OkStatus();
}

absl::Status Guard::allow(std::string_view authorization, v1::Permission permission,
                          std::string_view method) const {
    const auto caller = identify(authorization);
    absl::Status status = caller.status();
    if (caller.ok() && !has(caller->role, permission))
        status = absl::PermissionDeniedError(fmt::format(
            "{} with {} requires one of the roles {}; the token {} has {}", method,
            v1::Permission_Name(permission), roles_with(permission), caller->name, name_of(caller->role)));
    if (!status.ok())
        parts_->refused(caller.ok() ? caller->name : "", caller.ok() ? name_of(caller->role) : "", method,
                        status);
    return status;
}

absl::StatusOr<std::shared_ptr<Guard::Stream>> Guard::open_stream(
    std::string_view authorization, std::function<void(const absl::Status&)> end) {
    auto caller = identify(authorization);
    if (!caller.ok()) return caller.status();
    const AccessLimits& limits = parts_->limits;
    const std::scoped_lock lock(parts_->streams_mutex);
    if (parts_->streams.size() >= static_cast<std::size_t>(limits.max_streams))
        return absl::ResourceExhaustedError(fmt::format(
            "{} streams are open, the maximum; close others, or raise [server.limits] max_streams",
            limits.max_streams));
    int& own = parts_->streams_of[caller->digest];
    if (!open() && own >= limits.max_streams_per_token)
        return absl::ResourceExhaustedError(fmt::format(
            "{} has {} open streams, the maximum per token; close others, or raise [server.limits] "
            "max_streams_per_token",
            caller->name, own));
    ++own;
    std::shared_ptr<Stream> stream(new Stream(parts_, *std::move(caller), std::move(end)));
    parts_->streams.insert(stream.get());
    return stream;
}

int Guard::streams() const {
    const std::scoped_lock lock(parts_->streams_mutex);
    return static_cast<int>(parts_->streams.size());
}

void Guard::tick() {
    if (open()) return;
    if (stamp_of(parts_->file) != parts_->stamp) {
        const absl::Status read = parts_->read();
        if (read.ok())
            spdlog::info("reread tokens from {}", parts_->file.string());
        else
            spdlog::error("all tokens are rejected until this is fixed: {}", std::string(read.message()));
    }
    const auto tokens = parts_->current();
    std::set<std::string> valid;
    for (const Token& token : *tokens)
        if (token.valid(now_s())) valid.insert(to_hex(token.digest));
    std::vector<std::function<void(const absl::Status&)>> ends;
    {
        const std::scoped_lock lock(parts_->streams_mutex);
        for (Stream* stream : parts_->streams)
            if (!valid.contains(stream->caller_.digest) && stream->end_)
                ends.push_back(std::exchange(stream->end_, nullptr));
    }
    for (const auto& end : ends) end(absl::UnauthenticatedError(kGone));  // may destroy the stream
}

Guard::Stream::Stream(std::shared_ptr<Parts> parts, Caller caller,
                      std::function<void(const absl::Status&)> end)
    : parts_(std::move(parts)), caller_(std::move(caller)), end_(std::move(end)) {}

Guard::Stream::~Stream() {
    const std::scoped_lock lock(parts_->streams_mutex);
    parts_->streams.erase(this);
    if (const auto own = parts_->streams_of.find(caller_.digest); --own->second == 0)
        parts_->streams_of.erase(own);
}

}  // namespace kinevox
