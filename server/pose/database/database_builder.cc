#include "server/pose/database/database_builder.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <stdexcept>
#include <thread>

#include "kernels/body_silhouette.h"
#include "kernels/shared/camera.h"
#include "server/pose/database/aimed_view.h"
#include "server/pose/database/silhouette_codec.h"

namespace kinevox {
namespace {

using kernels::kCodeBytes;
using kernels::kViewBins;

// Renders and describes poses; one per thread.
class ViewMaker {
  public:
    ViewMaker(const PoseDatabase& database)
        : database_(database),
          model_(database.shape),
          renderer_(kernels::make_body_silhouette_renderer(kernels::Device::kCpu)),
          calculator_(
              kernels::make_moment_calculator(kernels::Device::kCpu, {.order = database.options.order})),
          scale_(database.values()),
          masks_(kViewBins) {
        kernels::moment_orthonormal_scale(database.options.order, scale_.data());
        for (auto& mask : masks_)
            mask.resize(static_cast<std::size_t>(database.options.side_px) * database.options.side_px);
    }

    // Fills one pose's part of every slab; `moments` gets [slab][bin][value] in floats.
    void make(const BodyCoordinates& pose, Vec3& middle, std::vector<float>& moments,
              std::vector<std::array<float, 2 * kViewBins>>& centres, std::vector<std::string>& silhouettes) {
        BodyCoordinates q = pose;
        q[0] = q[1] = q[2] = 0;
        q[kDofRootRotation + 2] = 0;
        model_.capsules(model_.forward(q), capsules_);
        middle = body_centre(capsules_);
        body_.resize(capsules_.size());
        for (std::size_t n = 0; n < capsules_.size(); ++n) {
            const BodyCapsule& from = capsules_[n];
            body_[n] = {{from.a[0], from.a[1], from.a[2]},
                        {from.b[0], from.b[1], from.b[2]},
                        from.radius_a,
                        from.radius_b};
        }
        const std::size_t slabs = database_.viewpoints.size();
        moments.resize(slabs * kViewBins * database_.values());
        centres.resize(slabs);
        silhouettes.resize(slabs);
        for (std::size_t slab = 0; slab < slabs; ++slab)
            make_slab(slab, middle, moments, centres[slab], silhouettes[slab]);
    }

  private:
    void make_slab(std::size_t slab, Vec3 middle, std::vector<float>& moments,
                   std::array<float, 2 * kViewBins>& centres, std::string& silhouette) {
        const PoseDatabaseOptions& options = database_.options;
        const Viewpoint& from = database_.viewpoints[slab];
        std::vector<kernels::BodyView> views(kViewBins);
        cameras_.resize(kViewBins);
        double metres_per_px = 1;
        for (int bin = 0; bin < kViewBins; ++bin) {
            const double azimuth =
                -2 * std::numbers::pi * bin / kViewBins;  // heading 0 minus the camera's direction
            const double c = std::cos(from.elevation), s = std::sin(from.elevation);
            const Vec3 eye =
                middle + (1 / from.inverse_distance) * Vec3{c * std::cos(azimuth), c * std::sin(azimuth), s};
            const AimedView view = aimed_view(eye, middle, database_.half_width_m(), options.side_px);
            metres_per_px = view.metres_per_px;
            cameras_[bin] = view.camera;
            views[bin] = {&cameras_[bin], masks_[bin].data(), {}};
        }
        renderer_->render(body_, views);
        std::vector<kernels::MomentView> to_describe(kViewBins);
        std::string bits;
        for (int bin = 0; bin < kViewBins; ++bin) {
            to_describe[bin] = {
                masks_[bin].data(), options.side_px, views[bin].bounds, {}, 0.5f * options.side_px};
            append_bits(masks_[bin], bits);
        }
        silhouette = compress_silhouettes(bits);
        calculator_->compute(to_describe, described_);
        const int values = database_.values();
        for (int bin = 0; bin < kViewBins; ++bin) {
            float* to = moments.data() + (slab * kViewBins + bin) * values;
            for (int v = 0; v < values; ++v) to[v] = described_[bin].values[v] * scale_[v];
            const double centre = 0.5 * (options.side_px - 1);
            centres[2 * bin] =
                static_cast<float>((described_[bin].mapping.centre_x_px - centre) * metres_per_px);
            centres[2 * bin + 1] =
                static_cast<float>((described_[bin].mapping.centre_y_px - centre) * metres_per_px);
        }
    }

    const PoseDatabase& database_;
    BodyModel model_;
    std::unique_ptr<kernels::BodySilhouetteRenderer> renderer_;
    std::unique_ptr<kernels::MomentCalculator> calculator_;
    std::vector<float> scale_;
    std::vector<BodyCapsule> capsules_;
    std::vector<kernels::TaperedCapsule> body_;
    std::vector<kernels::CameraModel> cameras_;
    std::vector<std::vector<std::uint8_t>> masks_;
    std::vector<kernels::SilhouetteMoments> described_;
};

// All moments are below the square root of the disk's area, since no silhouette exceeds the disk.
constexpr float kMomentStep = 1.7725f / 32767;

void store(PoseDatabase& database, int pose, Vec3 middle, const std::vector<float>& moments,
           const std::vector<std::array<float, 2 * kViewBins>>& centres,
           std::vector<std::string>& silhouettes) {
    const std::size_t per_pose = static_cast<std::size_t>(kViewBins) * database.values();
    database.body_centres[pose] = middle;
    for (std::size_t slab = 0; slab < database.slabs.size(); ++slab) {
        PoseDatabase::Slab& to = database.slabs[slab];
        for (std::size_t n = 0; n < per_pose; ++n) {
            const float steps = std::round(moments[slab * per_pose + n] / kMomentStep);
            to.moments[pose * per_pose + n] = static_cast<std::int16_t>(std::clamp(steps, -32767.f, 32767.f));
        }
        std::copy(centres[slab].begin(), centres[slab].end(),
                  to.centres.begin() + static_cast<std::ptrdiff_t>(pose) * 2 * kViewBins);
        to.silhouettes[pose] = std::move(silhouettes[slab]);
    }
}

// Allocates tens of megabytes, which takes time on a busy machine. False if stopped, as the functions below.
bool make_room(PoseDatabase& database, const std::stop_token& stop) {
    const std::size_t views = database.poses.size() * kViewBins;
    database.body_centres.resize(database.poses.size());
    for (PoseDatabase::Slab& slab : database.slabs) {
        if (stop.stop_requested()) return false;
        slab.moments.resize(views * database.values());
        slab.centres.resize(views * 2);
        slab.silhouettes.resize(database.poses.size());
        slab.codes.resize(views * kCodeBytes);
    }
    return !stop.stop_requested();
}

std::vector<float> moments_of_view(const PoseDatabase& database, int slab, std::size_t view) {
    std::vector<float> out(database.values());
    const std::int16_t* from = database.slabs[slab].moments.data() + view * out.size();
    for (std::size_t v = 0; v < out.size(); ++v) out[v] = database.moment_step * from[v];
    return out;
}

// Principal directions of the views' moments.
bool choose_code(PoseDatabase& database, const std::stop_token& stop) {
    const int values = database.values(), views = database.pose_count() * kViewBins;
    const int stride =
        std::max(1, views * static_cast<int>(database.slabs.size()) / 40000) | 1;  // odd: all bins
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(values);
    Eigen::MatrixXd squares = Eigen::MatrixXd::Zero(values, values);
    int count = 0;
    for (std::size_t slab = 0; slab < database.slabs.size(); ++slab) {
        if (stop.stop_requested()) return false;
        for (int view = static_cast<int>(slab) % stride; view < views; view += stride, ++count) {
            const std::vector<float> moments = moments_of_view(database, static_cast<int>(slab), view);
            const Eigen::VectorXd x =
                Eigen::Map<const Eigen::VectorXf>(moments.data(), values).cast<double>();
            sum += x;
            squares.selfadjointView<Eigen::Lower>().rankUpdate(x);
        }
    }
    const Eigen::VectorXd mean = sum / std::max(count, 1);
    const Eigen::MatrixXd full = squares.selfadjointView<Eigen::Lower>();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(full / std::max(count, 1) -
                                                                mean * mean.transpose());
    database.code_basis.assign(static_cast<std::size_t>(kCodeBytes) * values, 0.f);
    database.code_mean.assign(kCodeBytes, 0.f);
    for (int n = 0; n < std::min(kCodeBytes, values); ++n) {
        const Eigen::VectorXd direction = solver.eigenvectors().col(values - 1 - n);
        for (int v = 0; v < values; ++v)
            database.code_basis[n * values + v] = static_cast<float>(direction(v));
        database.code_mean[n] = static_cast<float>(direction.dot(mean));
    }
    // The range of the widest direction without one view in a thousand: clamping these costs less than
    // coarser steps for all.
    const double spread = std::sqrt(std::max(solver.eigenvalues()(values - 1), 1e-12));
    database.code_step = static_cast<float>(3.2 * spread / 63);
    return true;
}

bool encode_views(PoseDatabase& database, int first_pose, const std::stop_token& stop) {
    for (std::size_t slab = 0; slab < database.slabs.size(); ++slab) {
        PoseDatabase::Slab& to = database.slabs[slab];
        for (std::size_t view = static_cast<std::size_t>(first_pose) * kViewBins;
             view < to.codes.size() / kCodeBytes; ++view) {
            if (view % kViewBins == 0 && stop.stop_requested()) return false;
            database.encode(moments_of_view(database, static_cast<int>(slab), view).data(),
                            to.codes.data() + view * kCodeBytes);
        }
        to.search = kernels::MomentSlab::make(to.codes);
    }
    return !stop.stop_requested();
}

// Renders poses [first, end) on several threads. False if stopped.
bool make_views(PoseDatabase& database, int first, int threads, const BuildProgress& progress,
                const std::stop_token& stop) {
    std::atomic<int> next{first}, done{0};
    std::mutex mutex;
    const int count = database.pose_count() - first;
    int reported = 0;
    const auto work = [&] {
        ViewMaker maker(database);
        std::vector<float> moments;
        std::vector<std::array<float, 2 * kViewBins>> centres;
        std::vector<std::string> silhouettes;
        for (int pose = next++; pose < database.pose_count() && !stop.stop_requested(); pose = next++) {
            Vec3 middle;
            maker.make(database.poses[pose].coordinates, middle, moments, centres, silhouettes);
            store(database, pose, middle, moments, centres, silhouettes);
            const int percent = static_cast<int>(97LL * ++done / count);  // the remainder is for the codes
            if (!progress) continue;
            const std::lock_guard lock(mutex);
            if (percent > reported) progress((reported = percent) / 100.0);
        }
    };
    {
        std::vector<std::jthread> others;
        for (int n = 1; n < std::min(threads, count); ++n) others.emplace_back(work);
        work();
    }
    return !stop.stop_requested();
}

absl::Status check_pose(const LibraryPose& pose) {
    if (pose.label.empty() || pose.label.size() > 200 || pose.label.find('\n') != std::string::npos)
        return absl::InvalidArgumentError("a pose label must be one line of 1 to 200 characters");
    for (int dof = 0; dof < kBodyDofCount; ++dof)
        if (!std::isfinite(pose.coordinates[dof]))
            return absl::InvalidArgumentError(
                fmt::format("pose '{}': {} is not finite", pose.label, kBodyDofs[dof].name));
    return absl::OkStatus();
}

void append_added(PoseDatabase& database, std::span<const LibraryPose> poses) {
    for (const LibraryPose& pose : poses) {
        database.poses.push_back({pose.label, pose.coordinates, true});
        BodyCoordinates& q = database.poses.back().coordinates;
        q[0] = q[1] = q[2] = q[kDofRootRotation + 2] = 0;
    }
}

}  // namespace

UserChanges user_changes(const PoseDatabase& database) {
    UserChanges changes{{}, database.removed};
    for (const LibraryPose& pose : database.poses)
        if (pose.user_defined) changes.added.push_back(pose);
    return changes;
}

absl::StatusOr<PoseDatabase> build_pose_database(std::span<const kernels::CameraModel> cameras,
                                                 const BodyShape& shape, const PoseDatabaseOptions& options,
                                                 const UserChanges& changes, const BuildProgress& progress,
                                                 std::stop_token stop) {
    if (const std::string problem = options.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    for (const LibraryPose& pose : changes.added)
        if (const absl::Status status = check_pose(pose); !status.ok()) return status;
    PoseDatabase database;
    database.options = options;
    database.shape = shape;
    database.moment_step = kMomentStep;
    try {
        database.viewpoints = viewpoints_of(cameras, options);
        database.fingerprint = database_fingerprint(cameras, shape, options);
    } catch (const std::invalid_argument& error) {
        return absl::InvalidArgumentError(error.what());
    }
    database.slabs.resize(database.viewpoints.size());
    database.poses = library_poses(options.poses);
    std::erase_if(database.poses, [&](const LibraryPose& pose) {
        return std::find(changes.removed.begin(), changes.removed.end(), pose.label) != changes.removed.end();
    });
    database.removed = changes.removed;
    append_added(database, changes.added);
    if (!make_room(database, stop) || !make_views(database, 0, options.threads, progress, stop) ||
        !choose_code(database, stop) || !encode_views(database, 0, stop))
        return absl::CancelledError("building the pose database was cancelled");
    if (progress) progress(1);
    return database;
}

absl::Status add_poses(PoseDatabase& database, std::span<const LibraryPose> poses, std::stop_token stop) {
    for (const LibraryPose& pose : poses)
        if (const absl::Status status = check_pose(pose); !status.ok()) return status;
    const int first = database.pose_count();
    append_added(database, poses);
    if (!make_room(database, stop) || !make_views(database, first, database.options.threads, {}, stop) ||
        !encode_views(database, first, stop))
        return absl::CancelledError("adding the poses was cancelled");
    return absl::OkStatus();
}

}  // namespace kinevox
