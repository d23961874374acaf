// What one check of `kinevox doctor` found.
#pragma once

#include <string>
#include <vector>

namespace kinevox::doctor {

enum class Level { kOk, kWarn, kBad };  // as it should be; it works, with losses or risks; it does not work

// What root would do about it, as --fix-script writes it.
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
    Level level = Level::kOk;
    std::string check;      // "receive buffers"
    std::string what;       // one line
    std::string mend = {};  // one line; empty where there is nothing to mend
    std::vector<Fix> fixes = {};
};

}  // namespace kinevox::doctor
