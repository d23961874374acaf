#include <fmt/format.h>
#include <sys/timex.h>

#include <algorithm>
#include <sstream>

#include "server/tools/doctor/checks.h"
#include "server/tools/doctor/clock_state.h"

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

// "535.183.01" from the driver's own words.
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
    const bool wanted = facts.settings().pipeline.device == PipelineConfig::Device::kCuda;
    const Level worst = wanted ? Level::kBad : Level::kWarn;
    const std::string unused = wanted ? "" : "; the configuration computes on the CPU";
    const std::string version = driver_version(facts.machine);
    if (version.empty()) {
        if (has_nvidia_card(facts.machine))
            return {{worst, "GPU driver", "an NVIDIA card is there, but its driver is not loaded" + unused,
                     "install nvidia-driver and restart the machine"}};
        if (wanted)
            return {{Level::kBad, "GPU driver",
                     "the configuration asks for cuda, but there is no NVIDIA card",
                     "set device = \"cpu\" in [pipeline]"}};
        return {{Level::kOk, "GPU driver", "no NVIDIA card; none is asked for"}};
    }
    for (const char* node : {"dev/nvidiactl", "dev/nvidia0", "dev/nvidia-uvm"})
        if (!facts.machine.exists(node))
            return {{worst,
                     "GPU driver",
                     fmt::format("NVIDIA's driver {} is loaded, but /{} is missing{}", version, node, unused),
                     "nvidia-modprobe -c0 -u",
                     {{Fix::Kind::kCommand, "nvidia-modprobe -c0 -u"}}}};
    return {{Level::kOk, "GPU driver", fmt::format("NVIDIA's driver {}{}", version, unused)}};
}

Findings check_memory(const Facts& facts) {
    const std::string path = "sys/kernel/mm/transparent_hugepage/enabled";
    const std::string words = facts.machine.text(path);
    if (words.find("[never]") != std::string::npos)
        return {{Level::kWarn,
                 "huge pages",
                 "transparent huge pages are off: all stages may take up to 1.7 times longer",
                 "echo madvise > /" + path,
                 {{Fix::Kind::kTmpfile, "w /" + path + " - - - - madvise"}}}};
    if (words.empty())
        return {{Level::kWarn, "huge pages", "/" + path + " cannot be read",
                 "use a kernel with transparent huge pages"}};
    return {{Level::kOk, "huge pages", "transparent huge pages: " + words}};
}

Findings check_limits(const Facts& facts) {
    const int daemon = facts.machine.process("kinevoxd");
    const std::string who =
        daemon ? fmt::format("kinevoxd (process {})", daemon) : "a program that you start";
    std::istringstream lines(
        facts.machine.text(fmt::format("proc/{}/limits", daemon ? std::to_string(daemon) : "self")));
    for (std::string line; std::getline(lines, line);) {
        if (!line.starts_with("Max open files")) continue;
        std::istringstream numbers(line.substr(std::string("Max open files").size()));
        std::string soft;
        numbers >> soft;
        if (soft == "unlimited" || std::atoll(soft.c_str()) >= kOpenFiles)
            return {{Level::kOk, "open files", fmt::format("{} may have {} files open", who, soft)}};
        return {{Level::kBad, "open files",
                 fmt::format("{} may have only {} files open: recordings and clients need more", who, soft),
                 "start the daemon by systemd, whose unit asks for 65536, or `ulimit -n 65536` before"}};
    }
    return {
        {Level::kWarn, "open files", fmt::format("the limit of {} cannot be read", who), "run this as root"}};
}

ClockState clock_state() {
    timex now{};
    const int state = adjtimex(&now);
    return {state >= 0, state != TIME_ERROR && !(now.status & STA_UNSYNC),
            static_cast<double>(now.esterror) / 1000};
}

Finding judge(const ClockState& clock) {
    if (!clock.known)
        return {Level::kWarn, "clock", "the kernel does not tell whether the clock is set",
                "run this outside of a container"};
    if (clock.synchronised)
        return {Level::kOk, "clock",
                fmt::format("synchronised, by its own estimate to {:.1f} ms", clock.error_ms)};
    return {Level::kWarn,
            "clock",
            "not synchronised: times of recordings do not agree with other machines'",
            "apt install systemd-timesyncd (or chrony), then timedatectl set-ntp true",
            {{Fix::Kind::kCommand, "timedatectl set-ntp true"}}};
}

Findings check_clock(const Facts&) {
    return {judge(clock_state())};
}

}  // namespace kinevox::doctor
