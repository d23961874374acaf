#include "server/calibration/wand_clips.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "server/calibration/median.h"
#include "server/cameras/picture_reader.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxOfScene = 21;  // pictures that make the empty scene

// Per pixel and channel the median of up to kMaxOfScene pictures, evenly over the clip.
absl::StatusOr<Picture> empty_scene(const CameraClip& clip, const Camera& size) {
    const std::filesystem::path& file = clip.background.empty() ? clip.file : clip.background;
    auto reader = open_pictures(file, size);
    if (!reader.ok()) return reader.status();
    const auto step =
        std::max<std::int64_t>(1, (*reader)->promised() / static_cast<std::int64_t>(kMaxOfScene));
    std::vector<Picture> some;
    for (std::int64_t frame = 0; some.size() < kMaxOfScene; ++frame) {
        auto picture = (*reader)->next();
        if (absl::IsOutOfRange(picture.status())) break;
        if (!picture.ok()) return picture.status();
        if (frame % step == 0) some.push_back(*std::move(picture));
    }
    if (some.empty())
        return absl::InvalidArgumentError(fmt::format(
            "camera {}: {} holds no picture; give a video of the wand", clip.camera, file.string()));
    Picture out = some.front();
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

absl::StatusOr<std::vector<std::vector<WandPicture>>> find_wands(const std::vector<CameraClip>& clips,
                                                                 const WandSpec& wand,
                                                                 const ClipPictures& which,
                                                                 const SolveProgress& progress) {
    return for_pictures<WandPicture>(
        clips, which, "looking for the wand", progress,
        [&](const CameraClip& clip,
            const Camera& size) -> absl::StatusOr<std::function<WandPicture(const Picture&)>> {
            auto scene = empty_scene(clip, size);
            if (!scene.ok()) return scene.status();
            return [scene = *std::move(scene), wand](const Picture& picture) {
                return WandPicture{find_wand(picture, scene, wand), changed_part(picture, scene)};
            };
        });
}

}  // namespace kinevox
