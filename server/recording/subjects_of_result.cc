#include "server/recording/subjects_of_result.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr double kMaxDistance_m = 0.6;  // of a volume's centre from the joints' mean
// Of a component's pixels, in the projection of the subjects' voxels. Only a fraction of the voxels is
// projected, and far components have more voxels than pixels.
constexpr double kMinShownFraction = 0.05;
constexpr int kVoxelStep = 2;

std::optional<Vec3> centre_of(const std::array<Vec3, kJointNames.size()>& joints) {
    Vec3 sum;
    int count = 0;
    for (const Vec3& joint : joints) {
        if (std::isnan(joint.x)) continue;
        sum = sum + joint;
        ++count;
    }
    if (count == 0) return std::nullopt;
    return (1.0 / count) * sum;
}

void project(const Volume& volume, const Camera& camera, cv::Mat& mask) {
    const Vec3 o = volume.grid.origin_in_world;
    const double edge = volume.grid.voxel_m;
    for (const VolumeBrick& brick : volume.bricks)
        for (int z = 0; z < 8; z += kVoxelStep)
            for (int bit = 0; bit < 64; bit += kVoxelStep) {
                if (!(brick.occupancy[z] >> bit & 1)) continue;
                const int row = bit / 8;
                const auto pixel = camera.project({o.x + edge * (8 * brick.x + bit % 8 + 0.5),
                                                   o.y + edge * (8 * brick.y + row + 0.5),
                                                   o.z + edge * (8 * brick.z + z + 0.5)});
                if (!pixel || !(std::abs(pixel->x) < 1e5) || !(std::abs(pixel->y) < 1e5)) continue;
                const auto x = static_cast<int>(std::lround(pixel->x)),
                           y = static_cast<int>(std::lround(pixel->y));
                if (x >= 0 && y >= 0 && x < mask.cols && y < mask.rows) mask.at<std::uint8_t>(y, x) = 255;
            }
}

}  // namespace

SubjectMatcher::SubjectMatcher(std::span<const Trial> trials) : trials_(trials), rows_(trials.size()) {
    for (std::size_t t = 0; t < trials.size(); ++t)
        for (std::size_t n = 0; n < trials[t].size(); ++n)
            if (trials[t].session_frames[n] >= 0) rows_[t][trials[t].session_frames[n]] = n;
}

// The trial's id, 0: none is near, or its joints are withheld in this frame.
std::uint32_t SubjectMatcher::nearest(const SubjectResult& subject, std::int64_t frame) const {
    std::uint32_t id = 0;
    double distance_m = kMaxDistance_m;
    for (std::size_t t = 0; t < trials_.size(); ++t) {
        const auto row = rows_[t].find(frame);
        if (row == rows_[t].end()) continue;
        const auto centre = centre_of(trials_[t].joints[row->second]);
        if (!centre) continue;
        const double away_m = norm(*centre - subject.track.centre_in_world);
        if (away_m < distance_m) id = trials_[t].subject_id, distance_m = away_m;
    }
    return id;
}

std::vector<SubjectMatcher::Match> SubjectMatcher::match(const FrameResult& result, std::int64_t frame) {
    std::vector<Match> matches;
    for (const SubjectResult& subject : result.subjects) {
        const std::uint32_t own_id = subject.track.subject_id;
        auto known = known_.find(own_id);
        if (known == known_.end())
            if (const std::uint32_t id = nearest(subject, frame)) known = known_.emplace(own_id, id).first;
        if (known == known_.end()) continue;
        const bool taken = std::ranges::find(matches, known->second, &Match::id) != matches.end();
        if (!taken) matches.push_back({known->second, &subject});
    }
    std::ranges::sort(matches, {}, &Match::id);
    return matches;
}

std::vector<std::uint8_t> silhouette_of(std::span<const SubjectMatcher::Match> subjects,
                                        const kernels::Silhouettes& silhouettes, const Camera& camera) {
    std::vector<std::uint8_t> out(silhouettes.sharp.size(), 0);
    const cv::Mat sharp = as_mat(silhouettes.sharp.data(), silhouettes.width, silhouettes.height);
    cv::Mat projected = cv::Mat::zeros(sharp.size(), CV_8U), labels;
    for (const SubjectMatcher::Match& subject : subjects)
        if (subject.result->volume) project(*subject.result->volume, camera, projected);
    const int count = cv::connectedComponents(sharp, labels, 8, CV_32S);
    std::vector<int> area(count, 0), shown(count, 0);
    for (int y = 0; y < sharp.rows; ++y)
        for (int x = 0; x < sharp.cols; ++x) {
            const int label = labels.at<int>(y, x);
            ++area[label];
            shown[label] += projected.at<std::uint8_t>(y, x) != 0;
        }
    for (int y = 0; y < sharp.rows; ++y)
        for (int x = 0; x < sharp.cols; ++x) {
            const int label = labels.at<int>(y, x);
            if (label != 0 && shown[label] >= kMinShownFraction * area[label])
                out[static_cast<std::size_t>(y) * sharp.cols + x] = 255;
        }
    return out;
}

}  // namespace kinevox
