#include <cmath>
#include <cstdint>
#include <string>

#include "server/pose/body_model.h"
#include "server/pose/database/bvh_import.h"
#include "tests/fuzz/fuzz_check.h"

// In an accepted skeleton joints follow their parents; an imported pose is a pose of the body model.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto motion = kinevox::parse_bvh(std::string(data, data + size), "fuzz.bvh");
    FUZZ_CHECK(motion.ok() || motion.status().message().find('\n') == absl::string_view::npos);
    if (!motion.ok()) return 0;
    FUZZ_CHECK(!motion->joints.empty() && motion->frames >= 0);
    FUZZ_CHECK(motion->values.size() == static_cast<std::size_t>(motion->frames) * motion->values_per_frame);
    for (std::size_t j = 0; j < motion->joints.size(); ++j) {
        FUZZ_CHECK(motion->joints[j].parent < static_cast<int>(j));
        FUZZ_CHECK(motion->joints[j].first_value + static_cast<int>(motion->joints[j].channels.size()) <=
                   motion->values_per_frame);
    }
    const auto poses = kinevox::poses_from_bvh(*motion, "fuzz", {.interval_s = 0.1, .max_poses = 5});
    FUZZ_CHECK(poses.ok() || poses.status().message().find('\n') == absl::string_view::npos);
    if (!poses.ok()) return 0;
    FUZZ_CHECK(poses->size() <= 5);
    for (const kinevox::LibraryPose& pose : *poses)
        for (const double value : pose.coordinates) FUZZ_CHECK(std::isfinite(value));
    return 0;
}
