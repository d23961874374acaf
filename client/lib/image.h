// Images: JPEG in, PNG out, and shaded images of a volume from a camera, for viewing, not for measurement.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "client/lib/client.h"
#include "common/camera.h"
#include "common/volume.h"

namespace kinevox::client {

// R G B, or grey where the JPEG is. InvalidArgument for an incomplete or invalid JPEG.
absl::StatusOr<Image> decode_jpeg(std::span<const std::uint8_t> bytes);

// Written atomically (temporary file, rename). Unavailable, naming the file, if that fails.
absl::Status write_png(const Image& image, const std::filesystem::path& file);

struct RenderOptions {
    Rgb background{24, 26, 30};
    Rgb uncoloured{200, 190, 180};  // of volumes without colours
    double ambient = 0.55;          // 0..1; the rest of the light comes from next to the camera
    bool floor_grid = true;         // lines half a metre apart on z = 0, two metres around the volume
};

// R G B, the camera's size: every surface voxel as a cube, the nearest in front, shaded by the volume's
// smoothed normal.
Image render_volume(const Volume& volume, const Camera& camera, const RenderOptions& options = {});
// Of several subjects.
Image render_volumes(std::span<const Volume> volumes, const Camera& camera,
                     const RenderOptions& options = {});

// The same camera with images scaled by `scale`.
Camera scaled(const Camera& camera, double scale);

// A pinhole camera that sees the volumes completely, at `elevation` above the horizon, rotated about the
// vertical by `azimuth` from `towards` (a camera's centre); radians, px.
Camera oblique_camera(std::span<const Volume> volumes, const Vec3& towards_in_world, double azimuth,
                      double elevation, int width, int height);

// The square window of a camera's image around the volumes, twice as high as they appear, within the
// image; the full image without any. And a camera that sees just that window.
struct Window {
    int x = 0, y = 0, width = 0, height = 0;  // px
};
Window window_around(std::span<const Volume> volumes, const Camera& camera);
Camera cropped(const Camera& camera, const Window& window);
Image cropped(const Image& image, const Window& window);

// Images of equal height side by side, `gap_px` apart, on `background`.
Image side_by_side(const std::vector<Image>& images, int gap_px = 8, Rgb background = {255, 255, 255});

// Scaled by bilinear sampling to the given height; R G B.
Image scaled_to_height(const Image& image, int height);

}  // namespace kinevox::client
