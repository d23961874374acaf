#include "tests/support/test_data.h"

#include <cstdlib>

namespace kinevox::testing {

std::optional<std::filesystem::path> find_test_data(const std::string& relative_path) {
    const char* from_environment = std::getenv("KINEVOX_TEST_DATA");
    const std::filesystem::path root = from_environment ? from_environment : KINEVOX_DEFAULT_TEST_DATA;
    std::filesystem::path found = root / relative_path;
    std::error_code ignored;
    if (!std::filesystem::exists(found, ignored)) return std::nullopt;
    return found;
}

}  // namespace kinevox::testing
