#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

const char* name_of(Severity severity) {
    return severity == Severity::kOk ? "OK" : severity == Severity::kWarning ? "WARNING" : "ERROR";
}

int count(const Findings& findings, Severity severity) {
    return static_cast<int>(std::ranges::count(findings, severity, &Finding::severity));
}

std::vector<std::string> fixes_of(const Findings& findings, Fix::Kind kind) {
    std::vector<std::string> out;
    for (const Finding& finding : findings)
        for (const Fix& fix : finding.fixes)
            if (fix.kind == kind && std::ranges::find(out, fix.text) == out.end()) out.push_back(fix.text);
    return out;
}

// Shell code that writes these lines to the file, followed by `then`.
std::string here_document(const std::string& file, const std::vector<std::string>& lines,
                          const std::string& then) {
    if (lines.empty()) return "";
    std::string out = fmt::format("\ncat >{} <<'END'\n", file);
    for (const std::string& line : lines) out += line + "\n";
    return out + "END\n" + then;
}

}  // namespace

bool any_error(const Findings& findings) {
    return count(findings, Severity::kError) > 0;
}

std::string to_text(const Findings& findings, bool coloured) {
    const auto in_colour = [coloured](Severity severity) {
        const char* colour = severity == Severity::kOk ? "32" : severity == Severity::kWarning ? "33" : "31";
        return coloured ? fmt::format("\033[{}m{:<7}\033[0m", colour, name_of(severity))
                        : fmt::format("{:<7}", name_of(severity));
    };
    std::string out;
    for (const Finding& finding : findings) {
        out += fmt::format("{} {:<16} {}\n", in_colour(finding.severity), finding.check, finding.message);
        if (!finding.remedy.empty() && finding.severity != Severity::kOk)
            out += fmt::format("{:24} -> {}\n", "", finding.remedy);
    }
    const int errors = count(findings, Severity::kError), warnings = count(findings, Severity::kWarning);
    if (errors + warnings == 0) return out + "no problems\n";
    out += fmt::format("{} {}, {} {}", errors, errors == 1 ? "error" : "errors", warnings,
                       warnings == 1 ? "warning" : "warnings");
    const bool fixable =
        std::ranges::any_of(findings, [](const Finding& finding) { return !finding.fixes.empty(); });
    return out + (fixable ? "; `kinevox doctor --fix-script` prints the fixes for root\n" : "\n");
}

std::string to_json(const Findings& findings) {
    auto list = nlohmann::ordered_json::array();
    for (const Finding& finding : findings)
        list.push_back({{"level", name_of(finding.severity)},
                        {"check", finding.check},
                        {"message", finding.message},
                        {"remedy", finding.remedy}});
    const nlohmann::ordered_json all{{"error_count", count(findings, Severity::kError)},
                                     {"warning_count", count(findings, Severity::kWarning)},
                                     {"findings", list}};
    return all.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string fix_script(const Findings& findings) {
    std::string out =
        "#!/bin/sh\n# Fixes for the problems that `kinevox doctor` found. Review, then run as root.\nset "
        "-eu\n";
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
    return out.size() == nothing ? out + "# No fixes for root.\n" : out;
}

}  // namespace kinevox::doctor
