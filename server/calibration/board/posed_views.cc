#include "server/calibration/board/posed_views.h"

#include <algorithm>
#include <cmath>

namespace kinevox {
namespace {

constexpr double kInlierFraction =
    0.006;  // fraction of the image width: a frame set with a smaller error is an inlier of a relative pose
constexpr std::size_t kMaxTried = 40;  // relative poses tested per pair

}  // namespace

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
