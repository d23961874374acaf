#include "server/calibration/wand.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "server/calibration/extrinsics_checks.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr std::size_t kFewestTogether = 12;

// The wand along x from the first ball on.
std::vector<Vec3> wand_points(const WandSpec& wand) {
    return {{0, 0, 0}, {wand.middle_m, 0, 0}, {wand.length_m, 0, 0}};
}

Rigid3 pose_between(Vec3 first, Vec3 last) {
    const Vec3 x = normalized(last - first);
    const Vec3 aside = std::abs(x.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0};
    const Vec3 y = normalized(cross(aside, x)), z = cross(x, y);
    return {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, first};
}

cv::Point2d on_plane(const Camera& camera, Vec2 pixel) {
    const Vec3 d = direction_in_camera(camera, pixel);
    return {d.x / d.z, d.y / d.z};
}

}  // namespace

std::string WandSpec::check() const {
    if (!(length_m >= 0.05 && length_m <= 5))
        return fmt::format("the wand is {:g} mm long; 50 to 5000 are allowed", 1000 * length_m);
    if (!(middle_m > 0 && middle_m < 0.42 * length_m))
        return fmt::format(
            "the wand's middle ball is at {:g} of {:g} mm; it must be clearly nearer to the first end",
            1000 * middle_m, 1000 * length_m);
    return {};
}

absl::StatusOr<WandSpec> parse_wand(std::string_view text) {
    WandSpec wand;
    const std::size_t first = text.find(':'), second = text.find(':', first + 1);
    const auto read = [](std::string_view part, double& value) {
        const auto [end, code] = std::from_chars(part.data(), part.data() + part.size(), value);
        return code == std::errc{} && end == part.data() + part.size();
    };
    if (!text.starts_with("wand:") || second == std::string_view::npos ||
        !read(text.substr(first + 1, second - first - 1), wand.middle_m) ||
        !read(text.substr(second + 1), wand.length_m))
        return absl::InvalidArgumentError(fmt::format(
            "wand '{}': write wand:200:600, mm from the first ball to the second and to the third",
            text.substr(0, 60)));
    wand.middle_m /= 1000, wand.length_m /= 1000;
    if (const std::string problem = wand.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    return wand;
}

WandProcedure::WandProcedure(std::vector<Camera> lenses, const WandSpec& wand,
                             const ExtrinsicsOptions& options)
    : lenses_(std::move(lenses)), wand_(wand), options_(options) {}

void WandProcedure::add_observation(int moment, int camera, const WandSighting& sighting) {
    if (sighting) moments_[moment][camera] = *sighting;
}

std::vector<std::string> WandProcedure::hints() const {
    std::vector<int> seen(lenses_.size(), 0);
    for (const auto& [moment, views] : moments_)
        for (const auto& [camera, balls] : views) seen[camera] += views.size() > 1;
    std::vector<std::string> hints;
    for (std::size_t c = 0; c < lenses_.size(); ++c)
        if (seen[c] < static_cast<int>(kFewestTogether))
            hints.push_back(fmt::format(
                "camera {} has seen the wand together with another camera {} times; {} are needed",
                lenses_[c].name, seen[c], kFewestTogether));
    return hints;
}

std::vector<CameraPair> WandProcedure::pairs() const {
    std::vector<CameraPair> pairs;
    for (int a = 0; a < static_cast<int>(lenses_.size()); ++a)
        for (int b = a + 1; b < static_cast<int>(lenses_.size()); ++b) {
            std::vector<cv::Point2d> in_a, in_b;
            for (const auto& [moment, views] : moments_) {
                const auto one = views.find(a), other = views.find(b);
                if (one == views.end() || other == views.end()) continue;
                for (int k = 0; k < 3; ++k) {
                    in_a.push_back(on_plane(lenses_[a], one->second[k]));
                    in_b.push_back(on_plane(lenses_[b], other->second[k]));
                }
            }
            if (in_a.size() < 3 * kFewestTogether) continue;
            cv::setRNGSeed(1);
            cv::Mat inside, rotation, shift, points;
            const double threshold = 1.5 / std::min(lenses_[a].fx, lenses_[b].fx);
            const cv::Mat essential = cv::findEssentialMat(in_b, in_a, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC,
                                                           0.9999, threshold, inside);
            if (essential.rows != 3) continue;
            const int good = cv::recoverPose(essential, in_b, in_a, cv::Mat::eye(3, 3, CV_64F), rotation,
                                             shift, 1e3, inside, points);
            if (good < static_cast<int>(kFewestTogether)) continue;
            std::vector<double> scales;  // true length over the one between unit-spaced cameras
            for (std::size_t m = 0; m + 2 < in_a.size(); m += 3) {
                Vec3 ends[2];
                for (int end = 0; end < 2; ++end) {
                    const cv::Mat p = points.col(static_cast<int>(m) + 2 * end);
                    ends[end] = {p.at<double>(0) / p.at<double>(3), p.at<double>(1) / p.at<double>(3),
                                 p.at<double>(2) / p.at<double>(3)};
                }
                const double length = norm(ends[0] - ends[1]);
                if (inside.at<std::uint8_t>(static_cast<int>(m)) && length > 0)
                    scales.push_back(wand_.length_m / length);
            }
            if (scales.size() < 5) continue;
            std::nth_element(scales.begin(), scales.begin() + scales.size() / 2, scales.end());
            CameraPair pair{a, b, {}, good};
            for (int i = 0; i < 9; ++i) pair.a_from_b.rotation.m[i] = rotation.at<double>(i / 3, i % 3);
            pair.a_from_b.translation = scales[scales.size() / 2] *
                                        Vec3{shift.at<double>(0), shift.at<double>(1), shift.at<double>(2)};
            pairs.push_back(pair);
        }
    return pairs;
}

absl::StatusOr<ExtrinsicsResult> WandProcedure::solve(const SolveProgress& progress) const {
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    if (progress && !progress(0.02, "pairs of cameras")) return cancelled;
    const std::vector<CameraPair> joined = pairs();
    if (joined.empty())
        return absl::FailedPreconditionError(
            fmt::format("no two cameras have seen the whole wand together in {} moments or more; wave it for "
                        "a minute where two or more see "
                        "it",
                        kFewestTogether));
    const CameraTree tree = join_cameras(static_cast<int>(lenses_.size()), joined);
    ExtrinsicsResult result;
    Bundle fit;
    fit.points_in_thing = wand_points(wand_);
    std::vector<int> index(lenses_.size(), -1);
    for (const int c : tree.groups.front()) {
        index[c] = static_cast<int>(fit.cameras.size());
        fit.cameras.push_back(lenses_[c]);
        fit.cameras.back().camera_from_world = tree.camera_from_world[c];
    }
    for (std::size_t c = 0; c < lenses_.size(); ++c)
        if (index[c] < 0) {
            result.left_out.push_back(lenses_[c].name);
            result.findings.push_back(
                {Verdict::kNoGo, "unconnected", lenses_[c].name,
                 fmt::format("camera {} shares too few views of the wand with the others", lenses_[c].name),
                 "wave the wand where it and another camera see it at the same time"});
        }
    Bundle held_out = fit;
    int joint = 0;
    for (const auto& [moment, views] : moments_) {
        std::vector<Sight> first, last;
        for (const auto& [camera, balls] : views) {
            if (index[camera] < 0) continue;
            first.push_back({&fit.cameras[index[camera]], balls[0]});
            last.push_back({&fit.cameras[index[camera]], balls[2]});
        }
        const auto from = triangulate(first), to = triangulate(last);
        if (!from || !to) continue;
        const bool keep_out =
            options_.held_out_every > 1 && joint++ % options_.held_out_every == options_.held_out_every - 1;
        Bundle& bundle = keep_out ? held_out : fit;
        const int m = static_cast<int>(bundle.world_from_thing.size());
        bundle.world_from_thing.push_back(pose_between(*from, *to));
        for (const auto& [camera, balls] : views)
            for (int k = 0; k < 3 && index[camera] >= 0; ++k)
                bundle.observations.push_back({index[camera], m, k, balls[k], {}, {}});
    }
    BundleOptions options;
    options.robust_px = options_.robust_px;
    options.threads = options_.threads;
    BundleReport report, held_report;
    const SolveProgress within = [&](double part, const std::string& what) {
        return !progress || progress(0.1 + 0.8 * part, what);
    };
    if (absl::Status status = solve_bundle(fit, options, report, within); !status.ok()) return status;
    result.cameras = fit.cameras;
    result.fit_rms_px = report.rms_px;
    if (absl::Status status = place_held_out(fit, options, held_out, held_report); !status.ok()) return status;
    if (!held_out.observations.empty()) {
        result.held_out_rms_px = held_report.rms_px;
        result.scale = scale_error(held_out);
    }
    result.quality = camera_quality(fit, report, held_out, held_report);
    for (const BundleObservation& o : fit.observations) result.seen_points.push_back(observed_point(fit, o));
    append_findings(fit, result);
    if (progress && !progress(1, "done")) return cancelled;
    return result;
}

}  // namespace kinevox
