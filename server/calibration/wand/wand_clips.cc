#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "common/median.h"
#include "server/calibration/wand/wand.h"
#include "server/cameras/image_reader.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxOfScene = 21;  // images for the background

// Median per pixel and channel of up to kMaxOfScene images, evenly over the clip.
absl::StatusOr<Image> empty_scene(const CameraClip& clip, const Camera& size) {
    const std::filesystem::path& file = clip.background.empty() ? clip.file : clip.background;
    auto reader = open_images(file, size);
    if (!reader.ok()) return reader.status();
    const auto step =
        std::max<std::int64_t>(1, (*reader)->promised() / static_cast<std::int64_t>(kMaxOfScene));
    std::vector<Image> some;
    for (std::int64_t frame = 0; some.size() < kMaxOfScene; ++frame) {
        auto image = (*reader)->next();
        if (absl::IsOutOfRange(image.status())) break;
        if (!image.ok()) return image.status();
        if (frame % step == 0) some.push_back(*std::move(image));
    }
    if (some.empty())
        return absl::InvalidArgumentError(fmt::format(
            "camera {}: {} contains no image; give a video of the wand", clip.camera, file.string()));
    Image out = some.front();
    const std::size_t bytes = static_cast<std::size_t>(out.width) * out.height * out.channels;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::vector<std::uint8_t> values(some.size());
    for (std::size_t i = 0; i < bytes; ++i) {
        for (std::size_t k = 0; k < some.size(); ++k) values[k] = some[k].data[i];
        data[i] = median_of(values);
    }
    out.data = std::move(data);
    return out;
}

}  // namespace

absl::StatusOr<std::vector<std::vector<WandImage>>> detect_wands(const std::vector<CameraClip>& clips,
                                                                 const WandSpec& wand,
                                                                 const ClipImages& which,
                                                                 const SolveProgress& progress) {
    return for_images<WandImage>(
        clips, which, "detecting the wand", progress,
        [&](const CameraClip& clip,
            const Camera& size) -> absl::StatusOr<std::function<WandImage(const Image&)>> {
            auto scene = empty_scene(clip, size);
            if (!scene.ok()) return scene.status();
            return [scene = *std::move(scene), wand](const Image& image) {
                return WandImage{detect_wand(image, scene, wand), changed_fraction(image, scene)};
            };
        });
}

}  // namespace kinevox
