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
    stream.max_silence = std::chrono::milliseconds(static_cast<std::int64_t>(max_silence_s * 1000));
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox: {}; trying again\n", std::string(why.message()));
    };
    return stream;
}

void add_line_stream_options(CLI::App& verb, LineStreamOptions& options, std::vector<std::string> formats,
                             const std::string& out_help) {
    formats.insert(formats.begin(), {"jsonl", "csv"});
    verb.add_option("--format", options.format, "What is written of each message")
        ->check(CLI::IsMember(formats))
        ->capture_default_str();
    verb.add_option("--out", options.out, out_help);
    verb.add_option("--frames", options.frames, "Messages, 0: until stopped")->check(CLI::NonNegativeNumber);
    verb.add_flag("--lossless", options.lossless, "Every result, none missed");
    verb.add_option("--rate", options.rate_hz, "Messages a second at most")->check(CLI::NonNegativeNumber);
    verb.add_option("--longest-silence", options.max_silence_s,
                    "Give up after so many seconds without a message; 0: wait")
        ->check(CLI::NonNegativeNumber);
    verb.add_flag("--reconnect", options.reconnect, "Wait for the daemon when it goes away");
}

absl::StatusOr<LineWriter> LineWriter::open(const std::filesystem::path& file) {
    if (file.empty()) return LineWriter(nullptr, {});
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
    return absl::UnavailableError(fmt::format("cannot write {}: is the disk full?", name_.string()));
}

}  // namespace kinevox::cli
