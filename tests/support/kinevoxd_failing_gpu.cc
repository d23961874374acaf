// kinevoxd with a GPU that fails in the stage which the file KINEVOX_GPU_FAILS_IN names, as soon as there is
// that file.
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "server/daemon/kinevoxd.h"
#include "tests/support/failing_gpu.h"

int main(int argc, char** argv) {
    return kinevox::run_kinevoxd(argc, argv, [](kinevox::kernels::Device device) {
        const char* const file = std::getenv("KINEVOX_GPU_FAILS_IN");
        return std::make_unique<kinevox::testing::FailingGpu>(
            [path = std::filesystem::path(file ? file : "")](const std::string& stage) {
                std::error_code error;
                if (path.empty() || !std::filesystem::exists(path, error)) return false;
                std::string named;
                std::ifstream(path) >> named;
                return named == stage;
            },
            "", false, device);
    });
}
