// Hulls of a person's silhouettes: exact and without voxels, with the hull IoU; and as voxels, for
// measurements and overlays.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {

// Signed distance field of a silhouette.
class SilhouetteField {
  public:
    // Cells of one pixel, two in large images.
    SilhouetteField(const std::vector<std::uint8_t>& mask, int width, int height);

    bool empty() const { return cells_.empty(); }
    // px, positive inside the silhouette, bilinear between cells. NaN outside the image.
    float distance(float x, float y) const;
    // The same with its gradient.
    float distance(float x, float y, float& dx, float& dy) const;
    // About `count` points, evenly along the contour.
    std::vector<Vec2> contour(int count) const;
    // Bounding box, px.
    float left = 0, top = 0, right = 0, bottom = 0;

  private:
    int width_ = 0, height_ = 0, columns_ = 0, rows_ = 0;
    float step_ = 1;
    std::vector<float> cells_;
    std::vector<Vec2> edge_;
};

// The exact visual hull of one frame set: point queries against the silhouettes.
class SilhouetteHull {
  public:
    // `cameras` must outlive it. Cameras with an empty mask are ignored.
    SilhouetteHull(const std::vector<Camera>& cameras, const std::vector<SilhouetteMask>& images);

    // True if two or more silhouettes intersect; required by all other methods.
    bool usable() const { return middle_.has_value(); }
    Vec3 middle() const { return *middle_; }  // approximate centre of the subject, m
    const SilhouetteField* field(std::size_t camera) const { return fields_[camera].get(); }

    enum class Meets { kYes, kNo, kUnseen };
    // Whether the ray through a pixel of camera `own` intersects all other silhouettes at one point, within
    // `radius_m` of the centre; kUnseen if too few of them see any point of it.
    Meets meets(std::size_t own, const Ray& ray, double radius_m, double step_m) const;

    // The hull's lowest and highest point along `up` (world, length 1), on rays through the contours, m;
    // empty for an empty hull. The hull extends a little below the feet and above the head: below soles of
    // width `w` by about w / 2 times the tangent of the cameras' downward angle.
    struct Extent {
        Vec3 lowest, highest;
    };
    std::optional<Extent> extent(Vec3 up) const;

  private:
    // Lower bound of the distance to the hull; 0 inside. NaN if too few other cameras see the point.
    double clear_m(std::size_t own, Vec3 point) const;
    // Calls visit(point, its clear_m) along a ray of camera `own`, within `radius_m` of the centre, until it
    // returns false.
    template <class Visit>
    void walk(std::size_t own, const Ray& ray, double radius_m, double step_m, Visit visit) const;

    const std::vector<Camera>& cameras_;
    std::vector<std::unique_ptr<SilhouetteField>> fields_;  // per camera, null: no silhouette
    int min_others_ = 1;                                    // that must see a point
    std::optional<Vec3> middle_;
};

struct HullIou {
    std::vector<double> iou;  // per camera, mean over frame sets, 0 to 1; NaN: not evaluated
    double mean_iou = 0;      // over frame sets and cameras
    int frames = 0;
    std::vector<double> frame_set_min_iou;  // per evaluated frame set, of the camera with the lowest
};

struct HullIouOptions {
    int pixels = 1500;        // sampled per silhouette, evenly
    double radius_m = 1.6;    // along each ray, from the subject's centre
    double step_m = 0.004;    // along each ray near a silhouette
    int max_frame_sets = 40;  // an even selection
};

// Intersection over union of each silhouette and the projection of the hull of the other silhouettes, without
// voxels: a pixel belongs to the projection if its ray intersects all other silhouettes at one point. The
// hull lies within every silhouette, so the union is the silhouette. (A voxel hull is wider by about one
// voxel per side, which hides what a wrong camera removes.)
HullIou hull_iou(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                 const HullIouOptions& options = {});

struct SubjectHullOptions {
    double voxel_m = 0.015;
    double side_m = 2.6;  // of the box around the subject
};

// Voxel hull of one frame set's silhouettes, carved strictly, for measurements. Not thread safe.
class SubjectHull {
  public:
    SubjectHull(const std::vector<Camera>& cameras, const SubjectHullOptions& options);
    ~SubjectHull();

    // False with fewer than two untruncated silhouettes.
    bool carve(const std::vector<SilhouetteMask>& images);
    // Centres of the hull's voxels, m, world.
    std::vector<Vec3> voxels() const;
    // The hull's projection into a camera: height * width bytes, 0 or 255.
    void project(std::size_t camera, std::vector<std::uint8_t>& mask) const;

  private:
    struct State;
    std::unique_ptr<State> state_;
};

// A silhouette and its hull as an image, for the certificate.
struct SilhouetteOverlay {
    std::string camera;
    std::string png;  // white: both; orange: silhouette only; blue: hull only
};

// One per camera, of the frame set that most cameras see completely; none without a hull.
std::vector<SilhouetteOverlay> silhouette_overlays(const std::vector<Camera>& cameras,
                                                   const SilhouetteSet& silhouettes);

}  // namespace kinevox
