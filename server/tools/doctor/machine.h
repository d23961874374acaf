// Reads files of /proc, /sys and the system; tests use another root.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox::doctor {

class Machine {
  public:
    explicit Machine(std::filesystem::path root = "/") : root_(std::move(root)) {}

    // `path` from the machine's root: "proc/sys/net/core/rmem_max".
    std::filesystem::path at(const std::string& path) const { return root_ / path; }
    // Without the white space at its end; empty where it cannot be read.
    std::string text(const std::string& path) const;
    std::optional<long long> number(const std::string& path) const;  // leading number
    bool exists(const std::string& path) const;
    std::vector<std::string> names(const std::string& folder) const;  // in it, sorted
    // The process of that name; 0 if there is none.
    int process(const std::string& name) const;

  private:
    std::filesystem::path root_;
};

}  // namespace kinevox::doctor
