#include <cstdint>
#include <string>

#include "server/config/daemon_config.h"
#include "tests/fuzz/fuzz_check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto config =
        kinevox::parse_config_toml(std::string(data, data + size), "/etc/kinevox", "fuzz.toml", false);
    FUZZ_CHECK(config.ok() || config.status().message().find('\n') == absl::string_view::npos);
    if (!config.ok()) return 0;
    FUZZ_CHECK(kinevox::listen_address_problem(config->server.listen).empty());
    const auto& access = config->server.access;
    FUZZ_CHECK(access.tls_certificate_file.empty() == access.tls_key_file.empty());
    FUZZ_CHECK(config->pipeline.voxel_mm >= 2 && config->pipeline.voxel_mm <= 100);
    FUZZ_CHECK(config->source.studio.camera_count >= 2 && config->source.studio.camera_count <= 64);
    return 0;
}
