// The posed body against the silhouettes.
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "server/cameras/image_mat.h"
#include "server/pose/body_model.h"
#include "server/quality/samples.h"

namespace kinevox::quality {
namespace {

void add_circle(const Camera& camera, const float centre[3], float radius, std::vector<cv::Point>& points) {
    const Vec3 at{centre[0], centre[1], centre[2]};
    const auto pixel = camera.project(at);
    if (!pixel) return;
    const double depth = (camera.camera_from_world * at).z;
    const double r = 0.5 * (camera.fx + camera.fy) * radius / depth;
    constexpr int kSides = 20;
    for (int k = 0; k < kSides; ++k) {
        const double angle = 2 * CV_PI * k / kSides;
        points.emplace_back(static_cast<int>(std::lround(pixel->x + r * std::cos(angle))),
                            static_cast<int>(std::lround(pixel->y + r * std::sin(angle))));
    }
}

cv::Mat drawn(const Camera& camera, const std::vector<BodyCapsule>& capsules) {
    cv::Mat mask = cv::Mat::zeros(camera.height, camera.width, CV_8U);
    std::vector<cv::Point> points, hull;
    for (const BodyCapsule& capsule : capsules) {
        points.clear();
        add_circle(camera, capsule.a, capsule.radius_a, points);
        add_circle(camera, capsule.b, capsule.radius_b, points);
        if (points.empty()) continue;
        cv::convexHull(points, hull);
        cv::fillConvexPoly(mask, hull, cv::Scalar(255));
    }
    return mask;
}

}  // namespace

std::optional<double> measure_posed_iou(const Samples& seen, const SilhouetteSet& subject,
                                        std::span<const PosedFrame> poses, const BodyShape& body,
                                        std::vector<CameraMeasurements>& out) {
    std::map<std::uint64_t, const BodyPose*> by_sequence;
    for (const PosedFrame& frame : poses)
        if (frame.pose) by_sequence[frame.sequence] = frame.pose.get();
    const BodyModel model(body);
    std::vector<double> sum(out.size(), 0);
    std::vector<int> count(out.size(), 0);
    std::vector<BodyCapsule> capsules;
    for (std::size_t n = 0; n < seen.samples.size(); ++n) {
        const auto pose = by_sequence.find(seen.samples[n].sequence);
        if (pose == by_sequence.end()) continue;
        model.capsules(model.forward(pose->second->coordinates), capsules);
        for (std::size_t c = 0; c < out.size(); ++c) {
            const SilhouetteMask& image = subject.frame_sets[n][c];
            if (image.empty()) continue;
            const cv::Mat mask = as_mat(image.mask.data(), seen.cameras[c].width, seen.cameras[c].height);
            const cv::Mat posed = drawn(seen.cameras[c], capsules);
            const int common = cv::countNonZero(mask & posed), all = cv::countNonZero(mask | posed);
            sum[c] += static_cast<double>(common) / std::max(1, all);
            ++count[c];
        }
    }
    double mean = 0;
    int cameras = 0;
    for (std::size_t c = 0; c < out.size(); ++c) {
        if (count[c] == 0) continue;
        out[c].posed_iou = sum[c] / count[c];
        mean += *out[c].posed_iou;
        ++cameras;
    }
    if (cameras == 0) return std::nullopt;
    return mean / cameras;
}

void measure_posed_view(const std::vector<Camera>& cameras, std::span<const PosedFrame> poses,
                        std::vector<CameraMeasurements>& out) {
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        int count = 0, present = 0, cut = 0;
        for (const PosedFrame& frame : poses) {
            if (!frame.pose) continue;
            int inside = 0, outside = 0;
            for (const JointEstimate& joint : frame.pose->joints) {
                if (!joint.measured()) continue;
                const auto pixel = cameras[c].project(joint.in_world);
                const bool in_image = pixel && pixel->x >= 0 && pixel->y >= 0 &&
                                      pixel->x < cameras[c].width && pixel->y < cameras[c].height;
                ++(in_image ? inside : outside);
            }
            ++count;
            present += inside > 0;
            cut += inside > 0 && outside > 0;
        }
        if (count == 0) continue;
        out[c].seen_fraction = static_cast<double>(present) / count;
        out[c].truncated_fraction = static_cast<double>(cut) / count;
    }
}

}  // namespace kinevox::quality
