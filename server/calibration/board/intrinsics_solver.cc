#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "common/geometry.h"
#include "server/calibration/board/intrinsics.h"
#include "server/calibration/board/posed_views.h"

namespace kinevox {
namespace {

constexpr std::size_t kStartViews = 20;
constexpr std::size_t kEnoughToChoose = 8;    // with fewer views all are used
constexpr double kMinGain = 0.1;              // of the log determinant: 0.6 % of each standard deviation
constexpr double kUncertainFraction = 0.015;  // of the focal length: above it, a simpler model is fitted
using Matrix9 = Eigen::Matrix<double, 9, 9>;

}  // namespace

struct IntrinsicsSolver::State {
    Camera camera;
    std::vector<Vec3> points;
    bool k3;

    // A few views near the image centre do not determine all parameters; square pixels without tangential
    // distortion then keep the focal length from diverging.
    bool simple = false;
    int flags() const {
        return (k3 ? 0 : cv::CALIB_FIX_K3) |
               (simple
                    ? cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_USE_INTRINSIC_GUESS
                    : 0);
    }

    void gather(const std::vector<IntrinsicsView*>& views, std::vector<std::vector<cv::Point3f>>& on_board,
                std::vector<std::vector<cv::Point2f>>& seen) const {
        for (const IntrinsicsView* view : views) {
            on_board.emplace_back(), seen.emplace_back();
            for (const Corner& corner : view->corners) {
                const Vec3 p = points[corner.id];
                on_board.back().emplace_back(static_cast<float>(p.x), static_cast<float>(p.y),
                                             static_cast<float>(p.z));
                seen.back().emplace_back(static_cast<float>(corner.pixel.x),
                                         static_cast<float>(corner.pixel.y));
            }
        }
    }

    bool take(const cv::Mat& matrix, const cv::Mat& distortion) {
        for (int i = 0; i < 9; ++i)
            if (!std::isfinite(matrix.at<double>(i / 3, i % 3))) return false;
        camera.fx = matrix.at<double>(0, 0), camera.fy = matrix.at<double>(1, 1);
        camera.cx = matrix.at<double>(0, 2), camera.cy = matrix.at<double>(1, 2);
        const double* d = distortion.ptr<double>();
        camera.k1 = d[0], camera.k2 = d[1], camera.p1 = d[2], camera.p2 = d[3];
        camera.k3 = distortion.total() > 4 ? d[4] : 0;
        return camera.fx > 0 && camera.fy > 0;
    }

    // Information of one view about the intrinsics: their information matrix with the board's pose
    // eliminated, in units of the prior standard deviations.
    Matrix9 information(const IntrinsicsView& view, const Matrix9& scale) const {
        const auto pose = board_pose(camera, view.corners, points);
        if (!pose) return Matrix9::Zero();
        std::vector<cv::Point3d> on_board;
        for (const Corner& corner : view.corners) {
            const Vec3 p = points[corner.id];
            on_board.emplace_back(p.x, p.y, p.z);
        }
        const Vec3 r = rodrigues_from_rotation(pose->camera_from_board.rotation),
                   t = pose->camera_from_board.translation;
        const cv::Matx33d matrix(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
        const cv::Vec<double, 5> distortion(camera.k1, camera.k2, camera.p1, camera.p2, camera.k3);
        std::vector<cv::Point2d> seen;
        cv::Mat jacobian;
        cv::projectPoints(on_board, cv::Vec3d(r.x, r.y, r.z), cv::Vec3d(t.x, t.y, t.z), matrix, distortion,
                          seen, jacobian);
        const Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> all(
            jacobian.ptr<double>(), jacobian.rows, jacobian.cols);
        const Eigen::MatrixXd by_pose = all.leftCols(6), by_intrinsics = all.middleCols(6, 9) * scale;
        const Eigen::Matrix<double, 6, 6> pose_square = by_pose.transpose() * by_pose;
        const Eigen::MatrixXd mixed = by_pose.transpose() * by_intrinsics;
        const Matrix9 left =
            by_intrinsics.transpose() * by_intrinsics - mixed.transpose() * pose_square.ldlt().solve(mixed);
        return left.allFinite() ? left : Matrix9::Zero();
    }
};

IntrinsicsSolver::IntrinsicsSolver(std::string camera, int width, int height, std::vector<Vec3> board_points,
                                   bool k3)
    : state_(new State{{}, std::move(board_points), k3}) {
    Camera& c = state_->camera;
    c.name = std::move(camera);
    c.width = width, c.height = height;
    c.fx = c.fy = width;
    c.cx = 0.5 * (width - 1), c.cy = 0.5 * (height - 1);
}

IntrinsicsSolver::~IntrinsicsSolver() = default;

bool IntrinsicsSolver::start(const std::vector<IntrinsicsView*>& views) {
    std::vector<IntrinsicsView*> some;
    const std::size_t count = std::min(views.size(), kStartViews);
    for (std::size_t i = 0; i < count; ++i) some.push_back(views[i * views.size() / count]);
    IntrinsicsResult ignored;
    return solve(some, ignored);
}

void IntrinsicsSolver::measure_tilts(const std::vector<IntrinsicsView*>& views) const {
    for (IntrinsicsView* view : views)
        if (const auto pose = board_pose(state_->camera, view->corners, state_->points))
            view->tilt_deg =
                degrees(std::acos(std::min(1.0, std::abs(pose->camera_from_board.rotation(2, 2)))));
}

void IntrinsicsSolver::select_informative(std::vector<IntrinsicsView*>& views, std::size_t most) const {
    if (views.size() <= kEnoughToChoose) return;
    const double width = state_->camera.width;
    Matrix9 scale = Matrix9::Zero();  // prior standard deviations: f, c, then the coefficients
    scale.diagonal() << 0.3 * width, 0.3 * width, 0.1 * width, 0.1 * width, 0.3, 0.3, 0.01, 0.01,
        state_->k3 ? 0.3 : 1e-9;
    std::vector<Matrix9> adds;
    for (const IntrinsicsView* view : views) adds.push_back(state_->information(*view, scale));
    Matrix9 known = Matrix9::Identity();
    std::vector<IntrinsicsView*> chosen;
    std::vector<bool> taken(views.size(), false);
    double log_determinant = 0;
    while (chosen.size() < std::min(most, views.size())) {
        double best = -1;
        std::size_t which = 0;
        for (std::size_t v = 0; v < views.size(); ++v) {
            if (taken[v]) continue;
            const Eigen::LLT<Matrix9> root(known + adds[v]);
            if (root.info() != Eigen::Success) continue;
            const double value = 2 * root.matrixLLT().diagonal().array().log().sum();
            if (value - log_determinant > best) best = value - log_determinant, which = v;
        }
        if (best < 0 || (chosen.size() >= kEnoughToChoose && best < kMinGain)) break;
        taken[which] = true;
        known += adds[which];
        log_determinant += best;
        chosen.push_back(views[which]);
    }
    for (std::size_t v = 0; v < views.size(); ++v)
        if (!taken[v]) views[v]->use = ViewUse::kUnused, views[v]->reason = "others are more informative";
    std::sort(chosen.begin(), chosen.end());  // in frame order
    views = std::move(chosen);
}

bool IntrinsicsSolver::solve(const std::vector<IntrinsicsView*>& views, IntrinsicsResult& result) {
    std::vector<std::vector<cv::Point3f>> on_board;
    std::vector<std::vector<cv::Point2f>> seen;
    state_->gather(views, on_board, seen);
    cv::Mat distortion, stds, extrinsic_stds, errors;
    const double width = state_->camera.width, height = state_->camera.height;
    cv::Mat matrix =
        (cv::Mat_<double>(3, 3) << width, 0, (width - 1) / 2, 0, width, (height - 1) / 2, 0, 0, 1);
    std::vector<cv::Mat> rotations, translations;
    try {
        cv::setRNGSeed(1);
        result.rms_px =
            cv::calibrateCamera(on_board, seen, {state_->camera.width, state_->camera.height}, matrix,
                                distortion, rotations, translations, stds, extrinsic_stds, errors,
                                state_->flags(), {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 80, 1e-9});
    } catch (const cv::Exception&) {
        return false;
    }
    if (!std::isfinite(result.rms_px) || !state_->take(matrix, distortion)) return false;
    if (!state_->simple &&
        std::max(stds.at<double>(0), stds.at<double>(1)) > kUncertainFraction * state_->camera.fx) {
        state_->simple = true;
        return solve(views, result);
    }
    result.camera = state_->camera;
    for (int i = 0; i < 9 && i < static_cast<int>(stds.total()); ++i) result.stds[i] = stds.at<double>(i);
    if (state_->simple)
        result.stds[0] = result.stds[1];  // one focal length, its standard deviation is reported as fy
    for (std::size_t v = 0; v < views.size(); ++v) {
        views[v]->use = ViewUse::kUsed;
        views[v]->reason.clear();
        views[v]->rms_px = errors.at<double>(static_cast<int>(v));
    }
    return true;
}

void IntrinsicsSolver::measure_unused(IntrinsicsResult& result) const {
    double sum = 0;
    std::size_t corners = 0;
    for (IntrinsicsView& view : result.views) {
        if (view.use != ViewUse::kUnused) continue;
        const auto pose = board_pose(result.camera, view.corners, state_->points);
        if (!pose) continue;
        view.rms_px = pose->rms_px;
        sum += pose->rms_px * pose->rms_px * static_cast<double>(view.corners.size());
        corners += view.corners.size();
    }
    if (corners > 0) result.held_out_rms_px = std::sqrt(sum / static_cast<double>(corners));
}

}  // namespace kinevox
