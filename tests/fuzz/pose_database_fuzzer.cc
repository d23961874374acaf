#include <cstdint>
#include <string>

#include "server/pose/database/database_file.h"
#include "tests/fuzz/fuzz_check.h"

// The bytes as a file, and as the fields of a file with a matching header.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox;
    const std::string bytes(data, data + size);
    for (const std::string& file : {bytes, pose_database_header(bytes) + bytes}) {
        const auto database = parse_pose_database(file, "fuzz.kvxposes");
        FUZZ_CHECK(database.ok() || database.status().message().find('\n') == absl::string_view::npos);
        if (!database.ok()) continue;
        FUZZ_CHECK(!database->slabs.empty() && database->slabs.size() == database->viewpoints.size());
        for (std::size_t slab = 0; slab < database->slabs.size(); ++slab)
            if (database->pose_count() > 0) {
                const auto image = database->silhouette(static_cast<int>(slab), 0, 0);
                const auto side = static_cast<std::size_t>(database->options.side_px);
                FUZZ_CHECK(image.empty() || image.size() == side * side);
            }
        const UserChanges changes = user_changes(*database);
        FUZZ_CHECK(changes.added.size() <= database->poses.size());
    }
    return 0;
}
