#include <cstdint>
#include <string>

#include "common/volume_codec.h"
#include "tests/fuzz/fuzz_check.h"

// A decoded volume is valid and encodes without loss.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto volume = kinevox::decode_volume({data, size});
    if (!volume.ok()) return 0;
    FUZZ_CHECK(kinevox::volume_problem(*volume).empty());
    FUZZ_CHECK(volume->colours.empty() || volume->colours.size() == kinevox::surface_voxels(*volume).size());
    const std::string again = kinevox::encode_volume(*volume);
    const auto decoded =
        kinevox::decode_volume({reinterpret_cast<const std::uint8_t*>(again.data()), again.size()});
    FUZZ_CHECK(decoded.ok() && *decoded == *volume);
    const kinevox::Volume coarse = kinevox::coarsened(*volume, 1);
    FUZZ_CHECK(kinevox::volume_problem(coarse).empty());
    return 0;
}
