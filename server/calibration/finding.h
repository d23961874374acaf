// What a calibration's checks say, in plain words.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace kinevox {

enum class Verdict { kGo, kCare, kNoGo };

constexpr const char* to_text(Verdict verdict) {
    return verdict == Verdict::kGo ? "GO" : verdict == Verdict::kCare ? "CARE" : "NO-GO";
}

struct Finding {
    Verdict verdict = Verdict::kGo;
    std::string check;   // a short stable word, for programs: "scale", "mirrored", "knocked", ...
    std::string camera;  // its name where one is concerned
    std::string reason;  // one sentence
    std::string remedy;  // one sentence; empty for kGo
};

inline Verdict worst(const std::vector<Finding>& findings) {
    Verdict verdict = Verdict::kGo;
    for (const Finding& finding : findings)
        if (finding.verdict > verdict) verdict = finding.verdict;
    return verdict;
}

// How far a solve is: a part of 0 to 1 and what it does now. Returns false to cancel. May be empty.
using SolveProgress = std::function<bool(double part, const std::string& what)>;

}  // namespace kinevox
