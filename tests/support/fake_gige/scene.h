// What the fake camera sees, in the pixel format that it was set to.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "server/cameras/frame_source.h"
#include "tests/support/fake_gige/registers.h"

namespace kinevox::testing {

using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;

// The bytes of test image `number`: its number in the first eight, then a pattern that the number decides.
// A receiver detects each wrong byte.
std::vector<std::uint8_t> pattern_image(std::uint64_t number, std::size_t bytes);

// Images of a session's camera, again and again, or of its empty scene; without a session the pattern
// above.
class Scene {
  public:
    Scene() = default;
    // The first `most` images of the camera and of its background. What open_images() and read_session()
    // say.
    static absl::StatusOr<Scene> open(const std::filesystem::path& session, const std::string& camera,
                                      std::size_t most);

    bool is_pattern() const { return images_.empty(); }
    // The image of frame set `frame`, which all cameras number equally.
    Bytes image(std::uint64_t frame, bool empty_scene, const Registers& registers);

  private:
    std::vector<Image> images_, empty_;
    std::vector<Bytes> coded_, coded_empty_;  // in the format below, made when first needed
    std::uint32_t format_ = 0;
};

}  // namespace kinevox::testing
