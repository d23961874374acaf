#include "server/calibration/person/silhouette_hull.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "kernels/hull.h"
#include "kernels/projection.h"
#include "server/calibration/multi_view.h"
#include "server/cameras/image_mat.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {
namespace {

constexpr double kMaxCells = 800;  // about, along the longer side

constexpr double kInsidePx = 0.5;    // the distance field is smoothed at corners by about this much
constexpr int kContourPoints = 400;  // per silhouette, for the extent
constexpr double kRadius_m = 1.6, kStep_m = 0.008, kNearest_m = 0.3;

constexpr int kWidth = 270, kHeight = 360;  // px
constexpr double kMarginFraction = 0.12;    // around the subject

const cv::Vec3b kOutside(48, 36, 27), kBoth(240, 240, 240), kSilhouetteOnly(0, 94, 213),
    kHullOnly(210, 140, 30);

// The frame set that most cameras see, untruncated if possible; of those the one nearest to the centre of the
// session.
std::size_t best_frame_set(const SilhouetteSet& silhouettes) {
    std::size_t best = 0;
    double most = -1;
    for (std::size_t m = 0; m < silhouettes.frame_sets.size(); ++m) {
        double score = 0;
        for (const SilhouetteMask& image : silhouettes.frame_sets[m])
            score += image.empty() ? 0 : image.truncated ? 0.5 : 1;
        const double position = static_cast<double>(m) / static_cast<double>(silhouettes.frame_sets.size());
        score -= 0.4 * std::abs(position - 0.5);
        if (score > most) most = score, best = m;
    }
    return best;
}

std::string drawn(const cv::Mat& silhouette, const cv::Mat& hull) {
    const cv::Rect subject = cv::boundingRect(silhouette | hull);
    // The subject centred in a frame of the page's proportions.
    const double high = std::max<double>(subject.height, subject.width * double(kHeight) / kWidth) *
                        (1 + 2 * kMarginFraction);
    const double scale = kHeight / high;
    const double x = subject.x + 0.5 * subject.width, y = subject.y + 0.5 * subject.height;
    const cv::Matx23d image_from_pixel(scale, 0, 0.5 * kWidth - scale * x, 0, scale,
                                       0.5 * kHeight - scale * y);
    cv::Mat colours(silhouette.size(), CV_8UC3, cv::Scalar(kOutside)), out;
    colours.setTo(kSilhouetteOnly, silhouette);
    colours.setTo(kHullOnly, hull);
    colours.setTo(kBoth, silhouette & hull);
    cv::warpAffine(colours, out, image_from_pixel, cv::Size(kWidth, kHeight),
                   scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar(kOutside));
    std::vector<std::uint8_t> png;
    cv::imencode(".png", out, png);
    return {png.begin(), png.end()};
}

}  // namespace

SilhouetteField::SilhouetteField(const std::vector<std::uint8_t>& mask, int width, int height)
    : width_(width), height_(height) {
    const int step = std::max(1, static_cast<int>(std::lround(std::max(width, height) / kMaxCells)));
    step_ = static_cast<float>(step);
    const cv::Mat full = as_mat(mask.data(), width, height);
    const cv::Rect box = cv::boundingRect(full);
    if (box.area() == 0) return;
    left = static_cast<float>(box.x), top = static_cast<float>(box.y);
    right = static_cast<float>(box.x + box.width), bottom = static_cast<float>(box.y + box.height);
    // Within the silhouette the nearest background pixel is at most one pixel outside its box.
    const cv::Rect around =
        cv::Rect(box.x - 1, box.y - 1, box.width + 2, box.height + 2) & cv::Rect({}, full.size());
    cv::Mat inside = cv::Mat::zeros(full.size(), CV_32F), outside;
    cv::distanceTransform(full(around), inside(around), cv::DIST_L2, cv::DIST_MASK_PRECISE);
    cv::distanceTransform(255 - full, outside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
    columns_ = (width + step - 1) / step, rows_ = (height + step - 1) / step;
    cells_.resize(static_cast<std::size_t>(columns_) * rows_);
    for (int r = 0; r < rows_; ++r)
        for (int c = 0; c < columns_; ++c) {
            const int x = std::min(c * step, width - 1), y = std::min(r * step, height - 1);
            const float in = inside.at<float>(y, x);
            cells_[static_cast<std::size_t>(r) * columns_ + c] =
                in > 0 ? in - 0.5f : 0.5f - outside.at<float>(y, x);
        }
    std::vector<std::vector<cv::Point>> contours;
    cv::findContours(full, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
    for (const auto& contour : contours)
        for (const cv::Point p : contour)
            if (p.x > 1 && p.y > 1 && p.x < width - 2 && p.y < height - 2)  // not along the image border
                edge_.push_back({static_cast<double>(p.x), static_cast<double>(p.y)});
}

float SilhouetteField::distance(float x, float y, float& dx, float& dy) const {
    dx = dy = 0;
    if (!(x >= 0 && y >= 0 && x <= static_cast<float>(width_ - 1) && y <= static_cast<float>(height_ - 1)) ||
        cells_.empty())
        return std::numeric_limits<float>::quiet_NaN();
    const float u = std::min(x / step_, static_cast<float>(columns_ - 1) - 1e-3f);
    const float v = std::min(y / step_, static_cast<float>(rows_ - 1) - 1e-3f);
    const int c = static_cast<int>(u), r = static_cast<int>(v);
    const float a = u - static_cast<float>(c), b = v - static_cast<float>(r);
    const float* const row = &cells_[static_cast<std::size_t>(r) * columns_ + c];
    const float* const next = row + columns_;
    const float upper = row[0] + a * (row[1] - row[0]), lower = next[0] + a * (next[1] - next[0]);
    dx = ((1 - b) * (row[1] - row[0]) + b * (next[1] - next[0])) / step_;
    dy = (lower - upper) / step_;
    return upper + b * (lower - upper);
}

float SilhouetteField::distance(float x, float y) const {
    float dx, dy;
    return distance(x, y, dx, dy);
}

std::vector<Vec2> SilhouetteField::contour(int count) const {
    std::vector<Vec2> out;
    const std::size_t wanted = std::min<std::size_t>(count, edge_.size());
    for (std::size_t i = 0; i < wanted; ++i) out.push_back(edge_[i * edge_.size() / wanted]);
    return out;
}

SilhouetteHull::SilhouetteHull(const std::vector<Camera>& cameras, const std::vector<SilhouetteMask>& images)
    : cameras_(cameras), fields_(cameras.size()) {
    std::vector<Observation> observations;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (images[c].empty()) continue;
        auto field = std::make_unique<SilhouetteField>(images[c].mask, cameras[c].width, cameras[c].height);
        if (field->empty()) continue;
        observations.push_back(
            {&cameras[c], {0.5 * (field->left + field->right), 0.5 * (field->top + field->bottom)}});
        fields_[c] = std::move(field);
    }
    // A region that only two of many cameras see is no hull: outside the other images the cones of two
    // opposite cameras intersect in a long ghost.
    if (observations.size() >= 4) min_others_ = 2;
    if (observations.size() >= 2) middle_ = triangulate(observations);
}

double SilhouetteHull::clear_m(std::size_t own, Vec3 point) const {
    double clear = 0;
    int votes = 0;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (c == own || !fields_[c]) continue;
        const auto pixel = cameras_[c].project(point);
        if (!pixel) continue;
        const double inside =
            fields_[c]->distance(static_cast<float>(pixel->x), static_cast<float>(pixel->y));
        if (std::isnan(inside)) continue;
        ++votes;
        if (inside < -kInsidePx)
            clear = std::max(clear, (-inside - kInsidePx) * (cameras_[c].camera_from_world * point).z /
                                        std::max(cameras_[c].fx, cameras_[c].fy));
    }
    return votes >= min_others_ ? clear : std::nan("");
}

template <class Visit>
void SilhouetteHull::walk(std::size_t own, const Ray& ray, double radius_m, double step_m,
                          Visit visit) const {
    const double centre = dot(*middle_ - ray.origin_in_world, ray.direction_in_world);
    for (double depth = std::max(kNearest_m, centre - radius_m); depth < centre + radius_m;) {
        const Vec3 point = ray.origin_in_world + depth * ray.direction_in_world;
        const double clear = clear_m(own, point);
        if (!visit(point, clear)) return;
        // Less than the clearance: perspective and distortion change the scale.
        depth += std::isnan(clear) ? step_m : std::max(step_m, 0.6 * clear);
    }
}

SilhouetteHull::Meets SilhouetteHull::meets(std::size_t own, const Ray& ray, double radius_m,
                                            double step_m) const {
    Meets answer = Meets::kUnseen;
    walk(own, ray, radius_m, step_m, [&](Vec3, double clear) {
        if (!std::isnan(clear)) answer = clear == 0 ? Meets::kYes : Meets::kNo;
        return answer != Meets::kYes;
    });
    return answer;
}

std::optional<SilhouetteHull::Extent> SilhouetteHull::extent(Vec3 up) const {
    std::optional<Extent> extent;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!fields_[c]) continue;
        for (const Vec2 pixel : fields_[c]->contour(kContourPoints))
            walk(c, cameras_[c].ray_through(pixel), kRadius_m, kStep_m, [&](Vec3 point, double clear) {
                if (clear != 0) return true;  // also for NaN
                if (!extent) extent = Extent{point, point};
                if (dot(point - extent->lowest, up) < 0) extent->lowest = point;
                if (dot(point - extent->highest, up) > 0) extent->highest = point;
                return true;
            });
    }
    return extent;
}

HullIou hull_iou(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                 const HullIouOptions& options) {
    const std::size_t all = silhouettes.frame_sets.size(),
                      used = std::min<std::size_t>(all, options.max_frame_sets), count = cameras.size();
    std::vector<std::vector<double>> iou(used, std::vector<double>(count, std::nan("")));
    oneapi::tbb::parallel_for(std::size_t{0}, used, [&](std::size_t n) {
        const auto& images = silhouettes.frame_sets[n * all / used];
        const SilhouetteHull hull(cameras, images);
        if (!hull.usable()) return;
        for (std::size_t c = 0; c < count; ++c) {
            if (!hull.field(c) || images[c].truncated) continue;
            const auto& mask = images[c].mask;
            const auto area = static_cast<double>(mask.size() - std::count(mask.begin(), mask.end(), 0));
            const int step = std::max(1, static_cast<int>(std::sqrt(area / options.pixels)));
            std::int64_t inside = 0, asked = 0;
            for (int y = 0; y < cameras[c].height; y += step)
                for (int x = 0; x < cameras[c].width; x += step) {
                    if (!mask[static_cast<std::size_t>(y) * cameras[c].width + x]) continue;
                    const auto answer = hull.meets(c, cameras[c].ray_through({1.0 * x, 1.0 * y}),
                                                   options.radius_m, options.step_m);
                    asked += answer != SilhouetteHull::Meets::kUnseen;
                    inside += answer == SilhouetteHull::Meets::kYes;
                }
            if (asked > 0) iou[n][c] = static_cast<double>(inside) / static_cast<double>(asked);
        }
    });
    HullIou out;
    double total = 0;
    int counted = 0;
    for (std::size_t c = 0; c < count; ++c) {
        double sum = 0;
        int frame_sets = 0;
        for (const auto& frame_set : iou)
            if (!std::isnan(frame_set[c])) sum += frame_set[c], ++frame_sets;
        out.iou.push_back(frame_sets ? sum / frame_sets : std::nan(""));
        total += sum, counted += frame_sets;
    }
    for (const auto& frame_set : iou) {
        double lowest = std::numeric_limits<double>::infinity();
        for (const double v : frame_set)
            if (v < lowest) lowest = v;  // false for NaN
        if (std::isfinite(lowest)) out.frame_set_min_iou.push_back(lowest);
    }
    out.frames = static_cast<int>(out.frame_set_min_iou.size());
    out.mean_iou = counted ? total / counted : 0;
    return out;
}

struct SubjectHull::State {
    std::vector<Camera> cameras;
    SubjectHullOptions options;
    std::vector<kernels::CameraModel> models;
    std::unique_ptr<kernels::HullCarver> carver;
    kernels::VoxelVolume volume;
};

SubjectHull::SubjectHull(const std::vector<Camera>& cameras, const SubjectHullOptions& options)
    : state_(std::make_unique<State>()) {
    state_->cameras = cameras;
    state_->options = options;
    kernels::HullOptions strict;
    strict.min_views = cameras.size() >= 4 ? 3 : 2;
    strict.fill_radius_m = 0;
    state_->carver = kernels::make_hull_carver(kernels::Device::kCpu, strict);
    for (const Camera& camera : cameras) state_->models.push_back(to_kernel(camera));
}

SubjectHull::~SubjectHull() = default;

bool SubjectHull::carve(const std::vector<SilhouetteMask>& images) {
    std::vector<kernels::HullView> views;
    std::vector<Observation> observations;
    for (std::size_t c = 0; c < state_->cameras.size(); ++c) {
        if (images[c].empty()) continue;
        const Camera& camera = state_->cameras[c];
        const cv::Rect bounds = cv::boundingRect(as_mat(images[c].mask.data(), camera.width, camera.height));
        if (bounds.empty()) continue;
        const kernels::Rect box{bounds.x, bounds.y, bounds.x + bounds.width, bounds.y + bounds.height};
        views.push_back({&state_->models[c], images[c].mask.data(), box});
        if (!images[c].truncated)
            observations.push_back({&camera, {0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)}});
    }
    const auto middle = triangulate(observations);
    if (!middle || views.size() < 2) return false;
    const SubjectHullOptions& options = state_->options;
    kernels::Lattice lattice;
    lattice.voxel_m = static_cast<float>(options.voxel_m);
    const int size = 8 * static_cast<int>(std::ceil(options.side_m / options.voxel_m / 8));
    const double centre[3] = {middle->x, middle->y, middle->z};
    for (int axis = 0; axis < 3; ++axis) {
        lattice.size[axis] = size;
        lattice.origin[axis] = static_cast<float>(centre[axis] - 0.5 * size * options.voxel_m);
    }
    state_->carver->carve(views, lattice, state_->volume);
    return true;
}

std::vector<Vec3> SubjectHull::voxels() const {
    std::vector<Vec3> out;
    const kernels::Lattice& lattice = state_->volume.lattice;
    const double edge = lattice.voxel_m;
    for (const kernels::Brick& brick : state_->volume.bricks)
        for (int z = 0; z < kernels::kBrickEdge; ++z)
            for (std::uint64_t bits = brick.occupancy[z]; bits != 0; bits &= bits - 1) {
                const int bit = std::countr_zero(bits);
                const int x = bit % kernels::kBrickEdge, y = bit / kernels::kBrickEdge;
                out.push_back({lattice.origin[0] + edge * (brick.x * kernels::kBrickEdge + x + 0.5),
                               lattice.origin[1] + edge * (brick.y * kernels::kBrickEdge + y + 0.5),
                               lattice.origin[2] + edge * (brick.z * kernels::kBrickEdge + z + 0.5)});
            }
    return out;
}

void SubjectHull::project(std::size_t camera, std::vector<std::uint8_t>& mask) const {
    const Camera& c = state_->cameras[camera];
    mask.assign(static_cast<std::size_t>(c.width) * c.height, 0);
    kernels::Rect box;
    const float still[3] = {0, 0, 0};
    kernels::project_volume(state_->volume, state_->models[camera], still, 0, mask.data(), box);
}

std::vector<SilhouetteOverlay> silhouette_overlays(const std::vector<Camera>& cameras,
                                                   const SilhouetteSet& silhouettes) {
    std::vector<SilhouetteOverlay> out;
    if (silhouettes.frame_sets.empty()) return out;
    const std::vector<SilhouetteMask>& images = silhouettes.frame_sets[best_frame_set(silhouettes)];
    SubjectHull hull(cameras, {.voxel_m = 0.01});
    if (!hull.carve(images)) return out;
    std::vector<std::uint8_t> projected;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        if (images[c].empty()) continue;
        hull.project(c, projected);
        const cv::Size size(cameras[c].width, cameras[c].height);
        const cv::Mat silhouette = as_mat(images[c].mask.data(), size.width, size.height);
        const cv::Mat of_hull(size, CV_8U, projected.data());
        if (cv::countNonZero(silhouette) == 0) continue;
        out.push_back({cameras[c].name, drawn(silhouette, of_hull)});
    }
    return out;
}

}  // namespace kinevox
