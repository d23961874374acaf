// The checks of `kinevox doctor`, their input and their report. Each check examines one subject and changes
// nothing.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/cameras/aravis/live_source.h"
#include "server/config/daemon_config.h"

namespace kinevox::doctor {

// kWarning: it works, with losses or risks; kError: it does not work.
enum class Severity { kOk, kWarning, kError };

// A fix for root, as --fix-script writes it.
struct Fix {
    enum class Kind {
        kSysctl,   // "net.core.rmem_max=33554432", kept in /etc/sysctl.d
        kTmpfile,  // a line for /etc/tmpfiles.d
        kUdev,     // a line for /etc/udev/rules.d
        kCommand,
    };
    Kind kind;
    std::string text;
    bool operator==(const Fix&) const = default;
};

// Result of one check.
struct Finding {
    Severity severity = Severity::kOk;
    std::string check;        // "receive buffers"
    std::string message;      // one line
    std::string remedy = {};  // one line; empty for kOk
    std::vector<Fix> fixes = {};
};

// Reads files of /proc, /sys and the system; tests use another root.
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

using Findings = std::vector<Finding>;

// Input of the checks.
struct Facts {
    Machine machine;
    std::filesystem::path config_file;  // empty: none, defaults apply
    absl::StatusOr<DaemonConfig> config = DaemonConfig{};
    std::vector<FoundCamera> found;                  // cameras that answered
    std::filesystem::path state_folder, recordings;  // of the service or the user; empty: none
    std::uint64_t disk_test_bytes = std::uint64_t{256} << 20;

    // The configuration, or the defaults if it cannot be read.
    DaemonConfig settings() const { return config.ok() ? *config : DaemonConfig{}; }
};

Findings check_config(const Facts& facts);   // readable, without errors
Findings check_cameras(const Facts& facts);  // those of the configuration answer
Findings check_usb(const Facts& facts);      // permissions, speed and memory for USB3 Vision
Findings check_network(const Facts& facts);  // receive buffers, backlog

struct Interface {
    std::string name;
    std::uint32_t address = 0, mask = 0;  // IPv4, in host byte order
};
std::vector<Interface> interfaces();  // of this machine, with an IPv4 address
// Those in whose network a camera answered.
std::vector<Interface> with_cameras(const std::vector<Interface>& all,
                                    const std::vector<FoundCamera>& cameras);
// MTU, speed and path filter.
Findings check_interfaces(const Facts& facts, const std::vector<Interface>& interfaces);
Findings check_camera_interfaces(const Facts& facts);  // of those with cameras

Findings check_gpu(const Facts& facts);
Findings check_memory(const Facts& facts);  // huge pages
Findings check_limits(const Facts& facts);  // open files

struct ClockState {
    bool known = false, synchronised = false;
    double error_ms = 0;  // the kernel's estimate
};
ClockState clock_state();
Finding judge(const ClockState& clock);
Findings check_clock(const Facts& facts);

Findings check_state(const Facts& facts);  // the folder of the service's state
Findings check_disk(const Facts& facts);   // space and speed where recordings go; writes a file there
Findings check_port(const Facts& facts);

Findings check_all(const Facts& facts);

// The findings as text, as JSON and as a script; in report.cc.

bool any_error(const Findings& findings);
std::string to_text(const Findings& findings, bool coloured);
std::string to_json(const Findings& findings);  // one object
// A shell script with the fixes for root, to be reviewed before it runs.
std::string fix_script(const Findings& findings);

}  // namespace kinevox::doctor
