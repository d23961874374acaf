// Results of a calibration's checks.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace kinevox {

enum class Verdict { kGo, kCaution, kNoGo };

constexpr const char* to_text(Verdict verdict) {
    return verdict == Verdict::kGo ? "GO" : verdict == Verdict::kCaution ? "CAUTION" : "NO-GO";
}

struct Finding {
    Verdict verdict = Verdict::kGo;
    std::string check;   // stable code, listed in docs/calibration.md: "scale", "camera_moved", ...
    std::string camera;  // camera name, if the finding is about one camera
    std::string reason;  // one sentence
    std::string remedy;  // one sentence; empty for kGo
};

inline Verdict worst(const std::vector<Finding>& findings) {
    Verdict verdict = Verdict::kGo;
    for (const Finding& finding : findings)
        if (finding.verdict > verdict) verdict = finding.verdict;
    return verdict;
}

// Called with the progress (0 to 1) and the current step; returns false to cancel. May be empty.
using SolveProgress = std::function<bool(double progress, const std::string& what)>;

}  // namespace kinevox
