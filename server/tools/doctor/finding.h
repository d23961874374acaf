// Result of one check of `kinevox doctor`.
#pragma once

#include <string>
#include <vector>

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

struct Finding {
    Severity severity = Severity::kOk;
    std::string check;        // "receive buffers"
    std::string message;      // one line
    std::string remedy = {};  // one line; empty for kOk
    std::vector<Fix> fixes = {};
};

}  // namespace kinevox::doctor
