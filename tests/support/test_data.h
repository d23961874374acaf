// Finds the shared test data: the folder $KINEVOX_TEST_DATA, else ../shared/data beside the repository. The
// data is not part of the project, so tests that use it skip where it is missing.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace kinevox::testing {

std::optional<std::filesystem::path> find_test_data(const std::string& relative_path);

}  // namespace kinevox::testing

// At the start of a TEST body: `KINEVOX_REQUIRE_DATA(walk, "studio/walk");` declares `walk`, or skips.
#define KINEVOX_REQUIRE_DATA(variable, relative_path)                                      \
    const auto variable##_found = ::kinevox::testing::find_test_data(relative_path);       \
    if (!variable##_found)                                                                 \
        GTEST_SKIP() << "test data " << (relative_path)                                    \
                     << " is not here; set KINEVOX_TEST_DATA to the folder that holds it"; \
    const std::filesystem::path variable = *variable##_found
