#include <fmt/format.h>
#include <sys/timex.h>

#include <algorithm>
#include <sstream>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

constexpr long long kOpenFiles = 1024;

bool has_nvidia_card(const Machine& machine) {
    for (const std::string& device : machine.names("sys/bus/pci/devices"))
        if (machine.text("sys/bus/pci/devices/" + device + "/vendor") == "0x10de" &&
            machine.text("sys/bus/pci/devices/" + device + "/class").starts_with("0x03"))
            return true;
    return false;
}

// "535.183.01" from the driver's version text.
std::string driver_version(const Machine& machine) {
    std::istringstream words(machine.text("proc/driver/nvidia/version"));
    for (std::string word; words >> word;)
        if (!word.empty() && std::isdigit(static_cast<unsigned char>(word[0])) &&
            word.find('.') != std::string::npos)
            return word;
    return "";
}

}  // namespace

Findings check_gpu(const Facts& facts) {
    const kernels::Device device = facts.settings().pipeline.device;
    const bool wanted = device.is_cuda();
    const Severity worst = wanted ? Severity::kError : Severity::kWarning;
    const std::string unused = wanted ? "" : "; the configuration computes on the CPU";
    const std::string version = driver_version(facts.machine);
    if (version.empty()) {
        if (has_nvidia_card(facts.machine))
            return {{worst, "GPU driver", "an NVIDIA card is present, but its driver is not loaded" + unused,
                     "install nvidia-driver and restart the machine"}};
        if (wanted)
            return {{Severity::kError, "GPU driver",
                     fmt::format("the configuration selects {}, but there is no NVIDIA card",
                                 kernels::name_of(device)),
                     "set device = \"cpu\" in [pipeline]"}};
        return {{Severity::kOk, "GPU driver", "no NVIDIA card; none is configured"}};
    }
    for (const char* node : {"dev/nvidiactl", "dev/nvidia0", "dev/nvidia-uvm"})
        if (!facts.machine.exists(node))
            return {{worst,
                     "GPU driver",
                     fmt::format("NVIDIA's driver {} is loaded, but /{} is missing{}", version, node, unused),
                     "nvidia-modprobe -c0 -u",
                     {{Fix::Kind::kCommand, "nvidia-modprobe -c0 -u"}}}};
    const auto gpus = static_cast<int>(facts.machine.names("proc/driver/nvidia/gpus").size());
    if (wanted && gpus > 0 && device.index() >= gpus)
        return {{Severity::kError, "GPU driver",
                 fmt::format("the configuration selects {}, but NVIDIA's driver {} finds {} GPU{}",
                             kernels::name_of(device), version, gpus, gpus == 1 ? "" : "s"),
                 "set a device that `kinevox devices` lists in [pipeline]"}};
    return {{Severity::kOk, "GPU driver", fmt::format("NVIDIA's driver {}{}", version, unused)}};
}

Findings check_memory(const Facts& facts) {
    const std::string path = "sys/kernel/mm/transparent_hugepage/enabled";
    const std::string words = facts.machine.text(path);
    if (words.find("[never]") != std::string::npos)
        return {{Severity::kWarning,
                 "huge pages",
                 "transparent huge pages are off: all stages may take up to 1.7 times longer",
                 "echo madvise > /" + path,
                 {{Fix::Kind::kTmpfile, "w /" + path + " - - - - madvise"}}}};
    if (words.empty())
        return {{Severity::kWarning, "huge pages", "/" + path + " cannot be read",
                 "use a kernel with transparent huge pages"}};
    return {{Severity::kOk, "huge pages", "transparent huge pages: " + words}};
}

Findings check_limits(const Facts& facts) {
    const int daemon = facts.machine.process("kinevoxd");
    const std::string who =
        daemon ? fmt::format("kinevoxd (process {})", daemon) : "a program started by you";
    std::istringstream lines(
        facts.machine.text(fmt::format("proc/{}/limits", daemon ? std::to_string(daemon) : "self")));
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("Max open files")) continue;
        std::istringstream numbers(line.substr(std::string("Max open files").size()));
        std::string soft;
        numbers >> soft;
        if (soft == "unlimited" || std::atoll(soft.c_str()) >= kOpenFiles)
            return {{Severity::kOk, "open files", fmt::format("{} may have {} files open", who, soft)}};
        return {{Severity::kError, "open files",
                 fmt::format("{} may have only {} files open: recordings and clients need more", who, soft),
                 "start the daemon with systemd, whose unit sets 65536, or run `ulimit -n 65536` first"}};
    }
    return {{Severity::kWarning, "open files", fmt::format("the limit of {} cannot be read", who),
             "run this as root"}};
}

ClockState clock_state() {
    timex now{};
    const int state = adjtimex(&now);
    return {state >= 0, state != TIME_ERROR && !(now.status & STA_UNSYNC),
            static_cast<double>(now.esterror) / 1000};
}

Finding judge(const ClockState& clock) {
    if (!clock.known)
        return {Severity::kWarning, "clock", "the kernel does not report whether the clock is synchronised",
                "run this outside of a container"};
    if (clock.synchronised)
        return {Severity::kOk, "clock",
                fmt::format("synchronised, by its own estimate to {:.1f} ms", clock.error_ms)};
    return {Severity::kWarning,
            "clock",
            "not synchronised: times of recordings differ from those of other machines",
            "apt install systemd-timesyncd (or chrony), then timedatectl set-ntp true",
            {{Fix::Kind::kCommand, "timedatectl set-ntp true"}}};
}

Findings check_clock(const Facts&) {
    return {judge(clock_state())};
}

}  // namespace kinevox::doctor
