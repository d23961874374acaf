#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <utility>

#include "common/median.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/opencv_helpers.h"
#include "server/calibration/wand/wand.h"

namespace kinevox {
namespace {

constexpr double kInlierPx = 1.5;  // from the epipolar line
constexpr double kClearFraction =
    0.5;  // of the other assignment's distance: below it the assignment is certain
constexpr std::size_t kMaxSeeds = 4;

double between(Vec2 a, Vec2 b) {
    return std::hypot(a.x - b.x, a.y - b.y);
}

// Detections of both cameras in one frame set, in normalised image coordinates; the order of the balls in `b`
// is constant within a run.
struct Joint {
    std::vector<cv::Point2d> a, b;
    std::pair<int, int> run;
};

// Orders each camera's two balls by their motion; [camera][frame set] is the run, within which the order is
// constant.
std::map<int, std::map<int, int>> follow_balls(WandFrameSets& frame_sets) {
    std::map<int, std::map<int, int>> runs;
    std::map<int, std::vector<std::pair<int, std::vector<Vec2>*>>> by_camera;
    int step = 1 << 30;
    for (auto m = frame_sets.begin(); m != frame_sets.end(); ++m) {
        if (const auto next = std::next(m); next != frame_sets.end())
            step = std::min(step, next->first - m->first);
        for (auto& [camera, balls] : m->second) by_camera[camera].emplace_back(m->first, &balls);
    }
    for (auto& [camera, seen] : by_camera) {
        int run = 0;
        for (std::size_t i = 0; i < seen.size(); ++i) {
            std::vector<Vec2>& now = *seen[i].second;
            if (i > 0) {
                const std::vector<Vec2>& before = *seen[i - 1].second;
                double same = between(now[0], before[0]) + between(now[1], before[1]);
                double other = between(now[1], before[0]) + between(now[0], before[1]);
                if (other < same) std::swap(now[0], now[1]), std::swap(same, other);
                if (seen[i].first - seen[i - 1].first > 2 * step || same > kClearFraction * other) ++run;
            }
            runs[camera][seen[i].first] = run;
        }
    }
    return runs;
}

// Distance from the epipolar lines in both images.
double epipolar_distance(const cv::Matx33d& essential, cv::Point2d a, cv::Point2d b) {
    const cv::Vec3d x(b.x, b.y, 1), y(a.x, a.y, 1);  // y' E x = 0
    const cv::Vec3d in_a = essential * x, in_b = essential.t() * y;
    const double residual = std::abs(y.dot(in_a));
    return 0.5 * residual * (1 / std::hypot(in_a[0], in_a[1]) + 1 / std::hypot(in_b[0], in_b[1]));
}

struct Found {
    cv::Matx33d essential;
    std::vector<bool> inside;  // per joint
    std::vector<Joint> joints;
    int votes = 0;
};

bool fit(const std::vector<Joint>& joints, double threshold, cv::Matx33d& essential) {
    std::vector<cv::Point2d> a, b;
    for (const Joint& joint : joints) {
        a.insert(a.end(), joint.a.begin(), joint.a.end());
        b.insert(b.end(), joint.b.begin(), joint.b.end());
    }
    if (a.size() < 8) return false;
    cv::setRNGSeed(1);
    const cv::Mat found =
        cv::findEssentialMat(b, a, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, 0.9999, threshold);
    if (found.rows != 3) return false;
    essential = cv::Matx33d(found);
    return true;
}

// Finds the inliers; with equal balls (`alike`), swaps those that fit in the other order.
void sort_out(const cv::Matx33d& essential, double threshold, bool alike, std::vector<Joint> joints,
              Found& found) {
    found = {essential, {}, std::move(joints), 0};
    const auto residual = [&](const Joint& joint) {
        double most = 0;
        for (std::size_t k = 0; k < joint.a.size(); ++k)
            most = std::max(most, epipolar_distance(essential, joint.a[k], joint.b[k]));
        return most;
    };
    for (Joint& joint : found.joints) {
        double least = residual(joint);
        if (alike) {
            std::swap(joint.b[0], joint.b[1]);
            if (const double other = residual(joint); other < least)
                least = other;
            else
                std::swap(joint.b[0], joint.b[1]);
        }
        found.inside.push_back(least < threshold);
        found.votes += least < threshold;
    }
}

std::vector<Joint> inside(const Found& found) {
    std::vector<Joint> out;
    for (std::size_t i = 0; i < found.joints.size(); ++i)
        if (found.inside[i]) out.push_back(found.joints[i]);
    return out;
}

Found with_known_balls(const std::vector<Joint>& joints, double threshold) {
    Found found;
    if (cv::Matx33d essential; fit(joints, threshold, essential))
        sort_out(essential, threshold, false, joints, found);
    return found;
}

// Starts with a run in which neither camera confuses the balls, tries both assignments, and extends to all
// others.
Found with_alike_balls(const std::vector<Joint>& joints, double threshold) {
    std::map<std::pair<int, int>, std::vector<Joint>> stretches;
    for (const Joint& joint : joints) stretches[joint.run].push_back(joint);
    std::vector<std::vector<Joint>> seeds;
    for (auto& [run, stretch] : stretches)
        if (static_cast<int>(stretch.size()) >= kMinWandFrameSets) seeds.push_back(std::move(stretch));
    std::stable_sort(seeds.begin(), seeds.end(),
                     [](const auto& x, const auto& y) { return x.size() > y.size(); });
    if (seeds.size() > kMaxSeeds) seeds.resize(kMaxSeeds);
    Found best;
    for (std::vector<Joint>& seed : seeds)
        for (int way = 0; way < 2; ++way) {
            if (way == 1)
                for (Joint& joint : seed) std::swap(joint.b[0], joint.b[1]);
            cv::Matx33d essential;
            if (!fit(seed, threshold, essential)) continue;
            Found found;
            for (int round = 0; round < 4; ++round) {
                sort_out(essential, (round < 2 ? 3 : 1) * threshold, true, joints, found);
                if (!fit(inside(found), threshold, essential)) break;
            }
            if (found.votes > best.votes) best = std::move(found);
        }
    return best;
}

// Median of the true length over the one between cameras one unit apart; 0 for too few.
double scale_of(const std::vector<Joint>& joints, const cv::Matx33d& rotation, const cv::Vec3d& shift,
                double length_m) {
    // As cameras without distortion.
    Camera a, b;
    a.fx = a.fy = b.fx = b.fy = 1;
    for (int i = 0; i < 9; ++i) b.camera_from_world.rotation.m[i] = rotation.t().val[i];
    const cv::Vec3d back = -(rotation.t() * shift);
    b.camera_from_world.translation = {back[0], back[1], back[2]};
    std::vector<double> scales;
    for (const Joint& joint : joints) {
        const auto point = [&](const cv::Point2d& in_a, const cv::Point2d& in_b) {
            return triangulate({{&a, {in_a.x, in_a.y}}, {&b, {in_b.x, in_b.y}}});
        };
        const auto first = point(joint.a.front(), joint.b.front()),
                   last = point(joint.a.back(), joint.b.back());
        if (first && last && norm(*first - *last) > 0) scales.push_back(length_m / norm(*first - *last));
    }
    if (scales.size() < 5) return 0;
    return median_of(scales);
}

}  // namespace

std::vector<CameraPair> wand_pairs(const std::vector<Camera>& intrinsics, const std::vector<Vec3>& balls,
                                   const WandFrameSets& given) {
    WandFrameSets frame_sets = given;
    const bool alike = balls.size() == 2;
    std::map<int, std::map<int, int>> runs;
    if (alike) runs = follow_balls(frame_sets);
    std::vector<CameraPair> pairs;
    for (int a = 0; a < static_cast<int>(intrinsics.size()); ++a)
        for (int b = a + 1; b < static_cast<int>(intrinsics.size()); ++b) {
            std::vector<Joint> joints;
            for (const auto& [frame_set, views] : frame_sets) {
                const auto one = views.find(a), other = views.find(b);
                if (one == views.end() || other == views.end()) continue;
                Joint joint;
                for (const Vec2 pixel : one->second)
                    joint.a.push_back(normalised_image_point(intrinsics[a], pixel));
                for (const Vec2 pixel : other->second)
                    joint.b.push_back(normalised_image_point(intrinsics[b], pixel));
                if (alike) joint.run = {runs[a][frame_set], runs[b][frame_set]};
                joints.push_back(std::move(joint));
            }
            if (static_cast<int>(joints.size()) < kMinWandFrameSets) continue;
            const double threshold = kInlierPx / std::min(intrinsics[a].fx, intrinsics[b].fx);
            const Found found =
                alike ? with_alike_balls(joints, threshold) : with_known_balls(joints, threshold);
            const std::vector<Joint> good = inside(found);
            if (static_cast<int>(good.size()) < kMinWandFrameSets) continue;
            std::vector<cv::Point2d> in_a, in_b;
            for (const Joint& joint : good) {
                in_a.insert(in_a.end(), joint.a.begin(), joint.a.end());
                in_b.insert(in_b.end(), joint.b.begin(), joint.b.end());
            }
            cv::Mat rotation, shift;
            cv::recoverPose(cv::Mat(found.essential), in_b, in_a, cv::Mat::eye(3, 3, CV_64F), rotation,
                            shift);
            const double scale = scale_of(good, cv::Matx33d(rotation), cv::Vec3d(shift), norm(balls.back()));
            if (!(scale > 0)) continue;
            CameraPair pair{a, b, {}, static_cast<int>(good.size())};
            for (int i = 0; i < 9; ++i) pair.a_from_b.rotation.m[i] = rotation.at<double>(i / 3, i % 3);
            pair.a_from_b.translation =
                scale * Vec3{shift.at<double>(0), shift.at<double>(1), shift.at<double>(2)};
            pairs.push_back(pair);
        }
    return pairs;
}

void order_two_balls(const std::vector<Camera>& cameras, const std::vector<bool>& has_pose, double length_m,
                     WandFrameSets& frame_sets) {
    const auto pair_at = [&](const std::vector<Observation>& first,
                             const std::vector<Observation>& last) -> std::optional<std::pair<Vec3, Vec3>> {
        const auto from = triangulate(first), to = triangulate(last);
        if (!from || !to) return std::nullopt;
        return std::pair{*from, *to};
    };
    const auto residual = [&](const Camera& camera, const std::vector<Vec2>& balls,
                              const std::pair<Vec3, Vec3>& ends) {
        const auto p = camera.project(ends.first), q = camera.project(ends.second);
        return p && q ? between(*p, balls[0]) + between(*q, balls[1]) : 1e6;
    };
    for (auto m = frame_sets.begin(); m != frame_sets.end();) {
        auto& views = m->second;
        std::erase_if(views, [&](const auto& view) { return !has_pose[view.first]; });
        // The two most consistent cameras, in rays and in the wand's length, determine the order for the
        // others.
        double least = 1e9;
        std::optional<std::pair<Vec3, Vec3>> ends;
        for (auto a = views.begin(); a != views.end(); ++a)
            for (auto b = std::next(a); b != views.end(); ++b)
                for (int way = 0; way < 2; ++way) {
                    const Camera &one = cameras[a->first], &other = cameras[b->first];
                    const std::vector<Vec2> swapped{b->second[way], b->second[1 - way]};
                    const auto tried = pair_at({{&one, a->second[0]}, {&other, swapped[0]}},
                                               {{&one, a->second[1]}, {&other, swapped[1]}});
                    if (!tried) continue;
                    const double length_px = one.fx *
                                             std::abs(norm(tried->first - tried->second) - length_m) /
                                             norm(tried->first - one.centre_in_world());
                    const double score =
                        residual(one, a->second, *tried) + residual(other, swapped, *tried) + length_px;
                    if (score < least) least = score, ends = tried;
                }
        if (!ends) {
            m = frame_sets.erase(m);
            continue;
        }
        for (auto& [camera, balls] : views) {
            const std::vector<Vec2> swapped{balls[1], balls[0]};
            if (residual(cameras[camera], swapped, *ends) < residual(cameras[camera], balls, *ends))
                balls = swapped;
        }
        ++m;
    }
}

}  // namespace kinevox
