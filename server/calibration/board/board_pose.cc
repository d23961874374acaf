#include "server/calibration/board/board_pose.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

namespace kinevox {

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

}  // namespace kinevox
