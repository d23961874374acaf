#include "server/access/audit_log.h"

#include <absl/time/clock.h>
#include <absl/time/time.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/log_fields.h"

namespace kinevox {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using nlohmann::json;
using nlohmann::ordered_json;

constexpr std::size_t kMaxQueued = 4096;
constexpr int kRefusedPerSecond = 5;
constexpr std::size_t kMaxText = 200;

std::string now_utc() {
    return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::Now(), absl::UTCTimeZone());
}

// Replaces invalid UTF-8.
std::string dump(const ordered_json& line) {
    return line.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::string truncated(const std::string& text) {
    return text.size() <= kMaxText ? text
                                   : fmt::format("{}... {} bytes", text.substr(0, kMaxText), text.size());
}

ordered_json to_json(const Message& message, int depth);

// One value; of a repeated field the one at `index`.
ordered_json value_of(const Message& message, const FieldDescriptor* field, int index, int depth) {
    const auto* reflection = message.GetReflection();
    const bool many = field->is_repeated();
    switch (field->cpp_type()) {
        case FieldDescriptor::CPPTYPE_MESSAGE:
            return to_json(many ? reflection->GetRepeatedMessage(message, field, index)
                                : reflection->GetMessage(message, field),
                           depth + 1);
        case FieldDescriptor::CPPTYPE_STRING: {
            const std::string text = many ? reflection->GetRepeatedString(message, field, index)
                                          : reflection->GetString(message, field);
            return field->type() == FieldDescriptor::TYPE_BYTES ? fmt::format("{} bytes", text.size())
                                                                : truncated(text);
        }
        case FieldDescriptor::CPPTYPE_ENUM: {
            const int number = many ? reflection->GetRepeatedEnumValue(message, field, index)
                                    : reflection->GetEnumValue(message, field);
            const auto* value = field->enum_type()->FindValueByNumber(number);
            return value ? ordered_json(value->name()) : ordered_json(number);
        }
        case FieldDescriptor::CPPTYPE_BOOL:
            return many ? reflection->GetRepeatedBool(message, field, index)
                        : reflection->GetBool(message, field);
        case FieldDescriptor::CPPTYPE_DOUBLE:
            return many ? reflection->GetRepeatedDouble(message, field, index)
                        : reflection->GetDouble(message, field);
        case FieldDescriptor::CPPTYPE_FLOAT:
            return many ? reflection->GetRepeatedFloat(message, field, index)
                        : reflection->GetFloat(message, field);
        case FieldDescriptor::CPPTYPE_INT32:
            return many ? reflection->GetRepeatedInt32(message, field, index)
                        : reflection->GetInt32(message, field);
        case FieldDescriptor::CPPTYPE_UINT32:
            return many ? reflection->GetRepeatedUInt32(message, field, index)
                        : reflection->GetUInt32(message, field);
        case FieldDescriptor::CPPTYPE_INT64:
            return many ? reflection->GetRepeatedInt64(message, field, index)
                        : reflection->GetInt64(message, field);
        case FieldDescriptor::CPPTYPE_UINT64:
            return many ? reflection->GetRepeatedUInt64(message, field, index)
                        : reflection->GetUInt64(message, field);
    }
    return nullptr;
}

ordered_json to_json(const Message& message, int depth) {
    constexpr int kMaxDepth = 3, kMaxElements = 16;
    if (depth > kMaxDepth) return "...";
    ordered_json out = ordered_json::object();
    std::vector<const FieldDescriptor*> fields;
    message.GetReflection()->ListFields(message, &fields);
    for (const FieldDescriptor* field : fields) {
        if (field->name() == "lease_id") continue;  // it grants control
        if (!field->is_repeated()) {
            out[field->name()] = value_of(message, field, 0, depth);
            continue;
        }
        const int size = message.GetReflection()->FieldSize(message, field);
        ordered_json values = ordered_json::array();
        for (int i = 0; i < std::min(size, kMaxElements); ++i)
            values.push_back(value_of(message, field, i, depth));
        if (size > kMaxElements) values.push_back(fmt::format("... {} in total", size));
        out[field->name()] = std::move(values);
    }
    return out;
}

std::string line_of(const AuditEntry& entry) {
    ordered_json line;
    line["time"] = now_utc();
    line["caller"] = entry.caller;
    line["role"] = entry.role;
    line["peer"] = entry.peer;
    line["method"] = truncated(entry.method);
    line["outcome"] = entry.outcome;
    if (!entry.message.empty()) line["message"] = truncated(entry.message);
    if (!entry.request.empty()) line["request"] = ordered_json::parse(entry.request, nullptr, false);
    return dump(line) + "\n";
}

// Empty, or the error.
std::string append(const std::filesystem::path& file, const std::string& text) {
    const int descriptor = ::open(file.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0600);
    if (descriptor < 0) return std::strerror(errno);
    std::string problem;
    for (std::size_t at = 0; at < text.size() && problem.empty();) {
        const ssize_t written = ::write(descriptor, text.data() + at, text.size() - at);
        if (written >= 0)
            at += static_cast<std::size_t>(written);
        else if (errno != EINTR)
            problem = std::strerror(errno);
    }
    ::close(descriptor);
    return problem;
}

}  // namespace

std::string request_summary(const Message& request) {
    return dump(to_json(request, 0));
}

struct AuditLog::Parts {
    using Clock = std::chrono::steady_clock;

    std::filesystem::path file;
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<std::string> queue;
    std::uint64_t lost = 0;
    std::uint64_t refused = 0;  // counted only
    int refused_now = 0;        // written in this second
    Clock::time_point second{};
    bool closing = false, failing = false;
    std::thread thread;

    void put(std::string line) {  // mutex held
        if (queue.size() >= kMaxQueued) {
            ++lost;
            return;
        }
        queue.push_back(std::move(line));
        changed.notify_one();
    }

    void run() {
        std::unique_lock lock(mutex);
        while (!closing || !queue.empty() || refused || lost) {
            changed.wait_for(lock, std::chrono::seconds(1), [this] { return closing || !queue.empty(); });
            std::string text;
            for (const std::string& line : queue) text += line;
            queue.clear();
            if (refused && (closing || Clock::now() - second >= std::chrono::seconds(1))) {
                text += dump({{"time", now_utc()}, {"suppressed_refusals", refused}}) + "\n";
                refused = 0;
            }
            if (lost) text += dump({{"time", now_utc()}, {"lost_lines", lost}}) + "\n";
            lost = 0;
            if (text.empty()) continue;
            lock.unlock();
            write(text);
            lock.lock();
        }
    }

    void write(const std::string& text) {
        if (file.empty()) return;
        const std::string problem = append(file, text);
        if (!problem.empty() && !failing)
            spdlog::error("{}: the audit log cannot be written: {}", file.string(), problem);
        failing = !problem.empty();
    }
};

AuditLog::AuditLog(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {
    parts_->thread = std::thread([p = parts_.get()] { p->run(); });
}

absl::StatusOr<std::unique_ptr<AuditLog>> AuditLog::open(const std::filesystem::path& file) {
    auto parts = std::make_unique<Parts>();
    parts->file = file;
    if (!file.empty()) {
        std::error_code ignored;
        if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), ignored);
        if (const std::string problem = append(file, ""); !problem.empty())
            return absl::UnavailableError(
                fmt::format("{}: the audit log cannot be written: {}; correct [server] audit_file",
                            file.string(), problem));
    }
    return std::unique_ptr<AuditLog>(new AuditLog(std::move(parts)));
}

AuditLog::~AuditLog() {
    {
        const std::scoped_lock lock(parts_->mutex);
        parts_->closing = true;
        parts_->changed.notify_one();
    }
    parts_->thread.join();
}

void AuditLog::add(const AuditEntry& entry) {
    spdlog::debug("{} ({}) {}: {}", entry.caller, entry.role, entry.method, entry.outcome);
    std::string line = line_of(entry);
    const std::scoped_lock lock(parts_->mutex);
    parts_->put(std::move(line));
}

void AuditLog::add_refused(const AuditEntry& entry) {
    {
        const std::scoped_lock lock(parts_->mutex);
        const auto now = Parts::Clock::now();
        if (now - parts_->second >= std::chrono::seconds(1)) {
            parts_->second = now;
            parts_->refused_now = 0;
        }
        if (++parts_->refused_now > kRefusedPerSecond) {
            ++parts_->refused;
            return;
        }
    }
    {
        const LogFields fields{{"KINEVOX_EVENT", "call_refused"},
                               {"KINEVOX_METHOD", truncated(entry.method)},
                               {"KINEVOX_PEER", entry.peer},
                               {"KINEVOX_CALLER", entry.caller}};
        spdlog::warn("refused {}: {}", truncated(entry.method), entry.message);
    }
    std::string line = line_of(entry);
    const std::scoped_lock lock(parts_->mutex);
    parts_->put(std::move(line));
}

}  // namespace kinevox
