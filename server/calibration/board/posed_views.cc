#include "server/calibration/board/posed_views.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

namespace kinevox {
namespace {

constexpr double kInlierFraction =
    0.006;  // fraction of the image width: a frame set with a smaller error is an inlier of a relative pose
constexpr std::size_t kMaxTried = 40;  // relative poses tested per pair

}  // namespace

std::optional<BoardPose> board_pose(const Camera& camera, const std::vector<Corner>& corners,
                                    const std::vector<Vec3>& points) {
    if (corners.size() < 4) return std::nullopt;
    std::vector<cv::Point3d> on_board;
    std::vector<cv::Point2d> seen;
    for (const Corner& corner : corners) {
        const Vec3 p = points[corner.id];
        on_board.emplace_back(p.x, p.y, p.z);
        seen.emplace_back(corner.pixel.x, corner.pixel.y);
    }
    const cv::Matx33d matrix(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
    const cv::Vec<double, 5> distortion(camera.k1, camera.k2, camera.p1, camera.p2, camera.k3);
    std::vector<cv::Mat> rotations, translations;
    std::vector<double> errors;
    try {
        cv::solvePnPGeneric(on_board, seen, matrix, distortion, rotations, translations, false,
                            cv::SOLVEPNP_IPPE, cv::noArray(), cv::noArray(), errors);
    } catch (const cv::Exception&) {
        return std::nullopt;  // collinear corners
    }
    std::optional<BoardPose> best;
    double second = -1;
    for (std::size_t i = 0; i < rotations.size(); ++i) {
        cv::solvePnPRefineLM(on_board, seen, matrix, distortion, rotations[i], translations[i]);
        std::vector<cv::Point2d> back;
        cv::projectPoints(on_board, rotations[i], translations[i], matrix, distortion, back);
        double sum = 0;
        for (std::size_t k = 0; k < back.size(); ++k) sum += (back[k] - seen[k]).ddot(back[k] - seen[k]);
        const double rms = std::sqrt(sum / static_cast<double>(back.size()));
        if (!std::isfinite(rms) || !(translations[i].at<double>(2) > 0)) continue;
        BoardPose pose;
        pose.rms_px = rms;
        pose.camera_from_board.rotation = rotation_from_rodrigues(
            {rotations[i].at<double>(0), rotations[i].at<double>(1), rotations[i].at<double>(2)});
        pose.camera_from_board.translation = {translations[i].at<double>(0), translations[i].at<double>(1),
                                              translations[i].at<double>(2)};
        if (!best || rms < best->rms_px) {
            if (best) second = best->rms_px;
            best = pose;
        } else if (second < 0 || rms < second) {
            second = rms;
        }
    }
    if (!best) return std::nullopt;
    best->ambiguity_ratio = second < 0 ? 1e3 : second / std::max(best->rms_px, 1e-3);
    Vec3 middle;
    for (const Corner& corner : corners) middle += points[corner.id] / static_cast<double>(corners.size());
    const Mat3& r = best->camera_from_board.rotation;
    const Vec3 normal{r(0, 2), r(1, 2), r(2, 2)};
    const Vec3 to_camera = -normalized(best->camera_from_board * middle);
    best->tilt_rad = std::acos(std::clamp(dot(normal, to_camera), -1.0, 1.0));
    return best;
}

double view_error_px(const Camera& intrinsics, const Rigid3& camera_from_board,
                     const std::vector<Corner>& corners, const std::vector<Vec3>& points) {
    Camera camera = intrinsics;
    camera.camera_from_world = camera_from_board;
    double sum = 0;
    for (const Corner& corner : corners) {
        const auto seen = camera.project(points[corner.id]);
        if (!seen) return 1e6;
        const double dx = seen->x - corner.pixel.x, dy = seen->y - corner.pixel.y;
        sum += dx * dx + dy * dy;
    }
    return std::sqrt(sum / static_cast<double>(corners.size()));
}

Rigid3 best_world_from_board(const std::vector<Camera>& cameras, const std::vector<PosedView>& views,
                             const std::vector<Vec3>& points) {
    Rigid3 best;
    double least = 1e300;
    for (const PosedView& proposer : views) {
        const Rigid3 world_from_board =
            cameras[proposer.camera].camera_from_world.inverse() * proposer.pose.camera_from_board;
        double worst = 0;
        for (const PosedView& view : views)
            worst += std::min(1e3, view_error_px(cameras[view.camera],
                                                 cameras[view.camera].camera_from_world * world_from_board,
                                                 view.corners, points));
        if (worst < least) least = worst, best = world_from_board;
    }
    return best;
}

PosedViews::PosedViews(std::vector<Camera> intrinsics, std::vector<Vec3> points)
    : intrinsics_(std::move(intrinsics)), points_(std::move(points)) {}

void PosedViews::add(int frame_set, int camera, const std::vector<Corner>& corners) {
    if (auto pose = board_pose(intrinsics_[camera], corners, points_))
        views_[frame_set].push_back({camera, corners, *pose});
}

void PosedViews::thin(int most) {
    std::erase_if(views_, [](const auto& entry) { return entry.second.size() < 2; });
    const std::size_t all = views_.size();
    if (most <= 0 || all <= static_cast<std::size_t>(most)) return;
    std::size_t i = 0;
    std::erase_if(views_, [&](const auto&) {
        const bool keep = i * most / all != (i + 1) * most / all;
        ++i;
        return !keep;
    });
}

void PosedViews::drop_misfits(double max_rms_px) {
    for (auto& [frame_set, views] : views_)
        std::erase_if(views, [&](const PosedView& view) { return view.pose.rms_px > max_rms_px; });
    std::erase_if(views_, [](const auto& entry) { return entry.second.size() < 2; });
}

std::vector<int> PosedViews::frame_sets() const {
    std::vector<int> frame_sets;
    for (const auto& [frame_set, views] : views_) frame_sets.push_back(frame_set);
    return frame_sets;
}

std::vector<PosedView> PosedViews::at(int frame_set, const std::vector<int>& new_index) const {
    std::vector<PosedView> out;
    for (const PosedView& view : views_.at(frame_set)) {
        if (new_index[view.camera] < 0) continue;
        out.push_back(view);
        out.back().camera = new_index[view.camera];
    }
    return out;
}

std::vector<CameraPair> PosedViews::pairs() const {
    const int count = static_cast<int>(intrinsics_.size());
    std::vector<CameraPair> pairs;
    for (int a = 0; a < count; ++a)
        for (int b = a + 1; b < count; ++b) {
            std::vector<std::pair<const PosedView*, const PosedView*>> shared;
            for (const auto& [frame_set, views] : views_) {
                const PosedView *in_a = nullptr, *in_b = nullptr;
                for (const PosedView& view : views) {
                    if (view.camera == a) in_a = &view;
                    if (view.camera == b) in_b = &view;
                }
                if (in_a && in_b) shared.emplace_back(in_a, in_b);
            }
            if (shared.empty()) continue;
            CameraPair best{a, b, {}, 0};
            double best_error = 1e300;
            const std::size_t tried = std::min(shared.size(), kMaxTried);
            for (std::size_t t = 0; t < tried; ++t) {
                const auto& [from_a, from_b] = shared[t * shared.size() / tried];
                const Rigid3 a_from_b =
                    from_a->pose.camera_from_board * from_b->pose.camera_from_board.inverse();
                int votes = 0;
                double errors = 0;
                for (const auto& [in_a, in_b] : shared) {
                    const double limit = kInlierFraction * intrinsics_[a].width;
                    const double error = view_error_px(
                        intrinsics_[a], a_from_b * in_b->pose.camera_from_board, in_a->corners, points_);
                    votes += error < limit;
                    errors += std::min(error, 3 * limit);
                }
                if (errors < best_error)
                    best_error = errors, best.a_from_b = a_from_b, best.votes = std::max(votes, 1);
            }
            pairs.push_back(best);
        }
    return pairs;
}

}  // namespace kinevox
