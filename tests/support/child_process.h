// A program started by a test, its output and its end.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox::testing {

class ChildProcess {
  public:
    // Standard output and error go to files in `folder`. `environment`: NAME=VALUE, added to this process's
    // own.
    ChildProcess(const std::vector<std::string>& command, const std::filesystem::path& folder,
                 const std::vector<std::string>& environment = {});
    ~ChildProcess();  // kills it if it still runs
    ChildProcess(const ChildProcess&) = delete;
    ChildProcess& operator=(const ChildProcess&) = delete;

    void signal(int number) const;
    // The exit status, 128 + n after signal n; nothing if it still runs after patient(`limit`).
    std::optional<int> wait(std::chrono::milliseconds limit);
    // Waits until standard output has a whole first line, or the program has ended, or patient(ten seconds).
    std::string first_line();

    std::string output() const;
    std::string errors() const;
    double resident_mb() const;
    double cpu_ms() const;  // used by all its threads so far
    pid_t id() const { return id_; }

  private:
    std::filesystem::path output_, errors_;
    pid_t id_ = -1;
    std::optional<int> status_;
};

struct Ran {
    int status = 0;
    std::string output, errors;
};

// To its end, sixty seconds at most (then status 124).
Ran run(const std::vector<std::string>& command, const std::filesystem::path& folder,
        const std::vector<std::string>& environment = {});

}  // namespace kinevox::testing
