// The evidence of a sharp silhouette for the fit: viewing rays through its border, and a distance map.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "common/camera.h"
#include "kernels/outside_silhouette.h"
#include "kernels/segmentation.h"
#include "server/pose/pose_candidate.h"
#include "server/pose/pose_options.h"
#include "server/pose/view_colours.h"

namespace kinevox {

// Rays through the silhouette's border, one origin. `outward` is normal to the ray and points away from the
// silhouette. The image's edge is not a border.
struct ContourRays {
    Vec3 origin_in_world;
    std::vector<float> direction[3], outward[3];  // world, unit
    std::size_t size() const { return direction[0].size(); }
};

// Signed distance in px to the silhouette's border, positive inside. The image's edge is not a
// border, since nothing is known outside.
class SilhouetteDistance {
  public:
    // Of the pixels that are not 0 in `mask` or, if it is not null, in `also`; `bounds` is a box around them.
    void build(const std::uint8_t* mask, const std::uint8_t* also, int width, int height,
               const kernels::Rect& bounds, int side);
    // Bilinear; outside the map, minus the distance to the map. Empty outside the image, or without
    // silhouette.
    std::optional<double> at(Vec2 pixel) const;
    // The map itself, without what lies outside it.
    kernels::DistanceMapView map() const;
    bool has_shared() const { return !shared_.empty(); }
    // Whether most pixels around this one are in `also`.
    bool is_shared(Vec2 pixel) const;

  private:
    int image_width_ = 0, image_height_ = 0;
    int x0_ = 0, y0_ = 0, cell_ = 1, columns_ = 0, rows_ = 0;
    std::vector<float> distance_;
    std::vector<std::uint8_t> shared_;  // per cell, 1: most of it is in `also`; empty: none is
};

// Points of an image, px.
class PixelList {
  public:
    void assign(std::span<const Vec2> points);
    std::size_t size() const { return size_; }
    // To the nearest, px^2; `limit` where none is nearer than that.
    float squared_distance(Vec2 pixel, float limit = std::numeric_limits<float>::infinity()) const;

  private:
    static constexpr std::size_t kLanes = 8;  // that the compiler vectorises
    std::size_t size_ = 0;
    std::vector<float> x_, y_;  // from top to bottom; whole lanes, the rest infinitely far to the right
};

struct SilhouetteRays {
    const Camera* camera = nullptr;  // null: this camera is not used
    ContourRays contour;
    SilhouetteDistance distance;
    // px, of rays used and of rays not used; empty: the image was not read.
    PixelList border, border_without_contrast;
    ViewColours colours;  // empty: not read

    // How far a point lies inside the silhouette in the image, m at the point's depth; negative outside.
    // Empty where this camera does not see it.
    std::optional<double> inside_m(Vec3 in_world) const;
    // Whether the border nearest to a pixel is known to be without contrast.
    bool is_nearest_to_border_without_contrast(Vec2 pixel) const;
    // Whether this camera shows a point, and there this subject alone.
    bool shows_alone(Vec3 in_world) const;
};

// Whether a view shows foreground of other subjects, too.
bool shows_others(std::span<const SilhouetteRays> views);
// Whether at this point all views but one at most show another subject, too, or nothing: a limb may be there
// whether it fits or not.
bool is_among_others(std::span<const SilhouetteRays> views, Vec3 in_world);

// Reads the sharp silhouette. Reuses the memory of `out`. Without sharp pixels out.camera is null. No rays
// in `shared` (PoseView::shared), and the distance is to the border of both. `image`, where it is not empty:
// no rays through a border without contrast, which crosses clothes of which the silhouette lacks a part.
void read_silhouette(const Camera& camera, const kernels::Silhouettes& silhouettes,
                     const SilhouetteRayOptions& options, SilhouetteRays& out,
                     const kernels::ImageView& image = {}, const ForegroundPart* shared = nullptr);

}  // namespace kinevox
