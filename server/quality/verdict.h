// How far a result can be trusted, and if not, why.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/quality/judges.h"
#include "server/quality/measurements.h"

namespace kinevox::quality {

struct QualityReport {
    Trust verdict = Trust::kGood;
    // The most probable first: a cause that also explains the others comes before them.
    std::vector<Cause> causes;
    Measurements measurements;
};

QualityReport judge(const Measurements& measurements);
// Of several subjects the worst one's; its causes name it. At least one.
QualityReport judge_worst(std::span<const Measurements> subjects);

// quality.json.
std::string quality_json(const QualityReport& report);
// For the terminal: the verdict with its numbers in one line; cause and remedy, if it is not good.
std::string quality_text(const QualityReport& report);

}  // namespace kinevox::quality
