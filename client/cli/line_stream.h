// What the commands that stream lines have in common: their options, the output, and the end of a stream.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "client/cli/verbs.h"

namespace kinevox::cli {

struct LineStreamOptions {
    std::string format = "jsonl";
    std::filesystem::path out;  // empty: standard output
    int frames = 0;             // 0: until stopped
    std::uint32_t subject = 0;  // 0: all
    bool lossless = false, reconnect = false, overwrite = false;
    double max_rate_hz = 0;     // 0: no limit
    double idle_timeout_s = 0;  // 0: waits for ever

    client::StreamOptions stream() const;  // stopped by signals too
    v1::Delivery delivery() const { return lossless ? v1::DELIVERY_LOSSLESS : v1::DELIVERY_LATEST_ONLY; }
};

void add_subject_option(CLI::App& command, std::uint32_t& subject);

// `formats`: those besides jsonl and csv; `out_help`: the help of --out.
void add_line_stream_options(CLI::App& command, LineStreamOptions& options, std::vector<std::string> formats,
                             const std::string& out_help);

// Lines to a file, or to standard output where `file` is empty.
class LineWriter {
  public:
    // AlreadyExists for a file that exists, without `overwrite`.
    static absl::StatusOr<LineWriter> open(const std::filesystem::path& file, bool overwrite);
    LineWriter(LineWriter&& other) noexcept;
    ~LineWriter();

    bool print(const std::string& line);  // false when nothing reads it any more
    absl::Status close();                 // an error where a line was not written

  private:
    LineWriter(std::FILE* file, std::filesystem::path name) : file_(file), name_(std::move(name)) {}
    std::FILE* file_ = nullptr;  // null: standard output
    std::filesystem::path name_;
};

}  // namespace kinevox::cli
