#include "server/tools/doctor/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace kinevox::doctor {
namespace {

const char* name_of(Level level) {
    return level == Level::kOk ? "OK" : level == Level::kWarn ? "WARN" : "BAD";
}

int count(const Findings& findings, Level level) {
    return static_cast<int>(std::ranges::count(findings, level, &Finding::level));
}

std::vector<std::string> fixes_of(const Findings& findings, Fix::Kind kind) {
    std::vector<std::string> out;
    for (const Finding& finding : findings)
        for (const Fix& fix : finding.fixes)
            if (fix.kind == kind && std::ranges::find(out, fix.text) == out.end()) out.push_back(fix.text);
    return out;
}

// Writes these lines to a file of that name.
std::string here_document(const std::string& file, const std::vector<std::string>& lines,
                          const std::string& then) {
    if (lines.empty()) return "";
    std::string out = fmt::format("\ncat >{} <<'END'\n", file);
    for (const std::string& line : lines) out += line + "\n";
    return out + "END\n" + then;
}

}  // namespace

bool any_bad(const Findings& findings) {
    return count(findings, Level::kBad) > 0;
}

std::string to_text(const Findings& findings, bool coloured) {
    const auto in_colour = [coloured](Level level) {
        const char* colour = level == Level::kOk ? "32" : level == Level::kWarn ? "33" : "31";
        return coloured ? fmt::format("\033[{}m{:<5}\033[0m", colour, name_of(level))
                        : fmt::format("{:<5}", name_of(level));
    };
    std::string out;
    for (const Finding& finding : findings) {
        out += fmt::format("{} {:<16} {}\n", in_colour(finding.level), finding.check, finding.what);
        if (!finding.mend.empty() && finding.level != Level::kOk)
            out += fmt::format("{:22} -> {}\n", "", finding.mend);
    }
    const int bad = count(findings, Level::kBad), warn = count(findings, Level::kWarn);
    if (bad + warn == 0) return out + "nothing is wrong\n";
    out += fmt::format("{} bad, {} to look at", bad, warn);
    const bool fixable =
        std::ranges::any_of(findings, [](const Finding& finding) { return !finding.fixes.empty(); });
    return out + (fixable ? "; `kinevox doctor --fix-script` writes what root can mend\n" : "\n");
}

std::string to_json(const Findings& findings) {
    auto list = nlohmann::ordered_json::array();
    for (const Finding& finding : findings)
        list.push_back({{"level", name_of(finding.level)},
                        {"check", finding.check},
                        {"what", finding.what},
                        {"mend", finding.mend}});
    const nlohmann::ordered_json all{
        {"bad", count(findings, Level::kBad)}, {"warn", count(findings, Level::kWarn)}, {"findings", list}};
    return all.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string fix_script(const Findings& findings) {
    std::string out =
        "#!/bin/sh\n# Mends what `kinevox doctor` found and root can mend. Read it, then run it as "
        "root.\nset -eu\n";
    const std::size_t nothing = out.size();
    out += here_document("/etc/sysctl.d/60-kinevox.conf", fixes_of(findings, Fix::Kind::kSysctl),
                         "sysctl -p /etc/sysctl.d/60-kinevox.conf\n");
    out += here_document("/etc/tmpfiles.d/kinevox.conf", fixes_of(findings, Fix::Kind::kTmpfile),
                         "systemd-tmpfiles --create kinevox.conf\n");
    out += here_document("/etc/udev/rules.d/61-kinevox-doctor.rules", fixes_of(findings, Fix::Kind::kUdev),
                         "udevadm control --reload\nudevadm trigger --subsystem-match=usb --action=change\n");
    if (const auto commands = fixes_of(findings, Fix::Kind::kCommand); !commands.empty()) {
        out += "\n";
        for (const std::string& command : commands) out += command + "\n";
    }
    return out.size() == nothing ? out + "# There is nothing for root to mend.\n" : out;
}

}  // namespace kinevox::doctor
