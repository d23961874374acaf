#include "client/cli/line_stream.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <system_error>
#include <utility>

namespace kinevox::cli {

client::StreamOptions LineStreamOptions::stream() const {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.reconnect = reconnect;
    stream.idle_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(idle_timeout_s * 1000));
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox: {}; reconnecting\n", std::string(why.message()));
    };
    return stream;
}

void add_subject_option(CLI::App& command, std::uint32_t& subject) {
    command.add_option("--subject", subject, "Id of one subject (default: all)")->check(CLI::PositiveNumber);
}

void add_line_stream_options(CLI::App& command, LineStreamOptions& options, std::vector<std::string> formats,
                             const std::string& out_help) {
    formats.insert(formats.begin(), {"jsonl", "csv"});
    command.add_option("--format", options.format, "Output format")
        ->check(CLI::IsMember(formats))
        ->capture_default_str();
    command.add_option("--out", options.out, out_help);
    add_overwrite_option(command, options.overwrite);
    command.add_option("--frames", options.frames, "Number of messages (0: until stopped)")
        ->check(CLI::NonNegativeNumber);
    add_subject_option(command, options.subject);
    command.add_flag("--lossless", options.lossless, "Deliver every result in order");
    command.add_option("--max-rate", options.max_rate_hz, "Maximum rate (Hz; 0: no limit)")
        ->check(CLI::NonNegativeNumber);
    command
        .add_option("--idle-timeout", options.idle_timeout_s,
                    "Give up after this time without a message (s; 0: wait for ever)")
        ->check(CLI::NonNegativeNumber);
    command.add_flag("--reconnect", options.reconnect, "Reconnect when the daemon becomes unavailable");
}

absl::StatusOr<LineWriter> LineWriter::open(const std::filesystem::path& file, bool overwrite) {
    if (file.empty()) return LineWriter(nullptr, {});
    if (absl::Status free = check_overwrite(overwrite, file.string()); !free.ok()) return free;
    std::FILE* opened = std::fopen(file.c_str(), "w");
    if (!opened)
        return absl::UnavailableError(fmt::format("cannot write {}: {}; choose another --out", file.string(),
                                                  std::generic_category().message(errno)));
    return LineWriter(opened, file);
}

LineWriter::LineWriter(LineWriter&& other) noexcept
    : file_(std::exchange(other.file_, nullptr)), name_(std::move(other.name_)) {}

LineWriter::~LineWriter() {
    close().IgnoreError();
}

bool LineWriter::print(const std::string& line) {
    if (!file_) return print_line(line);
    return std::fprintf(file_, "%s\n", line.c_str()) >= 0 && std::fflush(file_) == 0;
}

absl::Status LineWriter::close() {
    std::FILE* file = std::exchange(file_, nullptr);
    if (!file) return absl::OkStatus();
    const bool failed = std::ferror(file) != 0;
    if (std::fclose(file) == 0 && !failed) return absl::OkStatus();
    return absl::UnavailableError(fmt::format("cannot write {}: check the free disk space", name_.string()));
}

}  // namespace kinevox::cli
