#include <cstdint>
#include <string_view>

#include "client/viewer/ghost_match.h"
#include "tests/fuzz/fuzz_check.h"

// A table of a second trial.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox::viewer;
    const auto trial = parse_ghost_trial({reinterpret_cast<const char*>(data), size}, "trial.csv");
    if (!trial.ok()) {
        FUZZ_CHECK(trial.status().message().find('\n') == absl::string_view::npos);
        return 0;
    }
    FUZZ_CHECK(!trial->instants.empty());
    for (std::size_t n = 1; n < trial->instants.size(); ++n)
        FUZZ_CHECK(trial->instants[n].time_s > trial->instants[n - 1].time_s);
    const double last_s = trial->instants.back().time_s;
    for (const TrialEvent event : {TrialEvent::kBegin, TrialEvent::kLeftFootDown, TrialEvent::kRightFootDown,
                                   TrialEvent::kHighestPoint, TrialEvent::kLowestPoint})
        if (const auto time_s = trial->time_of(event)) FUZZ_CHECK(trial->at(*time_s));
    FUZZ_CHECK(trial->at(last_s) && !trial->at(last_s + 1));
    return 0;
}
