#include "server/calibration/board/intrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/median.h"

namespace kinevox {
namespace {

constexpr std::size_t kMinViews = 3;
constexpr int kEnoughViews = 15;
constexpr double kEnoughCoverage = 0.7;

// Mean distance between the corners in both, px; nullopt without common corners.
std::optional<double> mean_movement(const std::vector<Corner>& a, const std::vector<Corner>& b) {
    double sum = 0;
    int count = 0;
    for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
        if (a[i].id == b[j].id) {
            sum += std::hypot(a[i].pixel.x - b[j].pixel.x, a[i].pixel.y - b[j].pixel.y), ++count;
            ++i, ++j;
        } else {
            (a[i].id < b[j].id ? i : j)++;
        }
    }
    if (count == 0) return std::nullopt;
    return sum / count;
}

double median(std::vector<double> values) {
    return values.empty() ? 0 : median_of(values);
}

void reject(IntrinsicsView& view, ViewUse use, std::string reason) {
    view.use = use;
    view.reason = std::move(reason);
}

void judge(const std::string& name, IntrinsicsResult& r, const Coverage& coverage) {
    const auto add = [&](Verdict verdict, const char* check, std::string reason, std::string remedy) {
        r.findings.push_back({verdict, check, name, std::move(reason), std::move(remedy)});
    };
    double steepest = 0;
    for (const IntrinsicsView& view : r.views)
        if (view.use == ViewUse::kUsed) steepest = std::max(steepest, view.tilt_deg);
    const double focal = r.camera.fx, focal_fraction = r.stds[0] / focal;
    if (steepest < 12)
        add(Verdict::kNoGo, "uniform_tilt",
            fmt::format("the board was parallel to the image plane in all views (tilted by at most {:.0f} "
                        "degrees), which does "
                        "not determine the focal length",
                        steepest),
            "show the board tilted by 20 to 45 degrees, in several directions");
    else if (focal_fraction > 0.03)
        add(Verdict::kNoGo, "uncertain_focal_length",
            fmt::format("the focal length of {:.0f} px is uncertain by {:.0f} px", focal, r.stds[0]),
            "add views with the board tilted and close, filling the image");
    else if (focal_fraction > 0.01)
        add(Verdict::kCaution, "uncertain_focal_length",
            fmt::format("the focal length of {:.0f} px is uncertain by {:.1f} px", focal, r.stds[0]),
            "add views with the board tilted and close, filling the image");
    if (r.used < 5)
        add(r.used < 4 ? Verdict::kNoGo : Verdict::kCaution, "too_few_views",
            fmt::format("only {} views of the board were used", r.used),
            "show the board in ten or more positions");
    if (r.coverage < 0.5)
        add(Verdict::kCaution, "coverage",
            fmt::format("the board was detected in {:.0f} % of the image; {} is the emptiest region",
                        100 * r.coverage, coverage.emptiest()),
            fmt::format("hold the board also in {} of the image", coverage.emptiest()));
    if (r.rms_px > 1.5)
        add(r.rms_px > 4 ? Verdict::kNoGo : Verdict::kCaution, "intrinsics_misfit",
            fmt::format("the reprojection error of the fitted intrinsics is {:.2f} px", r.rms_px),
            "use a flat stiff board, hold it still, and check its rows, columns and sizes");
}

// Rejects views that are blurred compared with the others.
void reject_blurred(const std::vector<double>& edges_px, double max_edge_ratio,
                    std::vector<IntrinsicsView>& views) {
    std::vector<double> edges;
    for (std::size_t v = 0; v < views.size(); ++v)
        if (views[v].use == ViewUse::kUnused && edges_px[v] > 0) edges.push_back(edges_px[v]);
    const double typical_px = median(edges);
    for (std::size_t v = 0; v < views.size(); ++v)
        if (views[v].use == ViewUse::kUnused && edges_px[v] > std::max(3.0, max_edge_ratio * typical_px))
            reject(views[v], ViewUse::kBlurred,
                   fmt::format("blurred: edges are {:.1f} px wide, {:.1f} px are usual here", edges_px[v],
                               typical_px));
}

// Views parallel to the image plane are kept only for regions that nothing else covers. `covered`: empty.
std::vector<IntrinsicsView*> without_parallel(const std::vector<IntrinsicsView*>& candidates,
                                              Coverage covered, double min_tilt_deg) {
    for (const IntrinsicsView* view : candidates)
        if (view->tilt_deg >= min_tilt_deg)
            for (const Corner& corner : view->corners) covered.add(corner.pixel);
    std::vector<IntrinsicsView*> chosen;
    for (IntrinsicsView* view : candidates) {
        std::vector<Vec2> pixels;
        for (const Corner& corner : view->corners) pixels.push_back(corner.pixel);
        if (view->tilt_deg < min_tilt_deg && !covered.is_new(pixels)) {
            reject(*view, ViewUse::kParallel,
                   fmt::format("nearly parallel to the image plane ({:.0f} degrees) and covers no new region",
                               view->tilt_deg));
        } else {
            if (view->tilt_deg < min_tilt_deg)
                for (const Vec2 pixel : pixels) covered.add(pixel);
            chosen.push_back(view);
        }
    }
    if (chosen.size() >= kMinViews) return chosen;
    // Parallel in all views: solved anyway, so that the findings give the reason.
    for (IntrinsicsView* view : candidates) reject(*view, ViewUse::kUnused, "");
    return candidates;
}

// True if any view is rejected.
bool reject_outliers(const std::vector<IntrinsicsView*>& chosen) {
    std::vector<double> errors;
    for (const IntrinsicsView* view : chosen) errors.push_back(view->rms_px);
    const double limit = std::max(1.0, 3 * median(errors));
    bool any = false;
    for (IntrinsicsView* view : chosen)
        if (view->rms_px > limit && chosen.size() > kMinViews + 1) {
            reject(*view, ViewUse::kOutlier,
                   fmt::format("outlier: reprojection error {:.1f} px", view->rms_px));
            any = true;
        }
    return any;
}

}  // namespace

IntrinsicsProcedure::IntrinsicsProcedure(std::string camera, int width, int height, const BoardSpec& board,
                                         const IntrinsicsOptions& options)
    : camera_(std::move(camera)),
      width_(width),
      height_(height),
      board_(board),
      options_(options),
      coverage_(width, height) {}

IntrinsicsView IntrinsicsProcedure::add_observation(int frame, const BoardDetection& detection) {
    IntrinsicsView view;
    view.frame = frame;
    view.corners = detection.corners;
    if (detection.mirrored_image)
        reject(view, ViewUse::kMirrored, "the image is mirrored: switch the camera's mirroring off");
    else if (!detection.found())
        reject(view, ViewUse::kNotFound, "the board was not detected");
    else if (detection.edge_px > options_.max_edge_px)
        reject(view, ViewUse::kBlurred, fmt::format("blurred: edges are {:.1f} px wide", detection.edge_px));
    for (const IntrinsicsView& other : views_) {
        if (view.use != ViewUse::kUnused) break;
        if (other.use != ViewUse::kUnused) continue;
        const auto moved = mean_movement(view.corners, other.corners);
        if (moved && *moved < options_.same_view_fraction * width_ &&
            view.corners.size() <= other.corners.size())
            reject(view, ViewUse::kDuplicate, fmt::format("duplicate of frame {}", other.frame));
    }
    if (view.use == ViewUse::kUnused)
        for (const Corner& corner : view.corners) coverage_.add(corner.pixel);
    views_.push_back(view);
    edges_px_.push_back(detection.edge_px);
    return view;
}

int IntrinsicsProcedure::usable() const {
    return static_cast<int>(std::count_if(views_.begin(), views_.end(),
                                          [](const IntrinsicsView& v) { return v.use == ViewUse::kUnused; }));
}

bool IntrinsicsProcedure::complete() const {
    return usable() >= kEnoughViews && coverage_.fraction() >= kEnoughCoverage;
}

std::vector<std::string> IntrinsicsProcedure::hints() const {
    std::vector<std::string> hints;
    const auto count = [&](ViewUse use) {
        return std::count_if(views_.begin(), views_.end(),
                             [&](const IntrinsicsView& v) { return v.use == use; });
    };
    if (usable() == 0) {
        hints.push_back(
            count(ViewUse::kMirrored) > 0
                ? fmt::format("camera {} delivers a mirror image: switch its mirroring off", camera_)
            : count(ViewUse::kBlurred) > 0
                ? fmt::format("camera {} detects the board blurred: hold it still, add light, focus", camera_)
                : fmt::format("camera {} has not detected the board", camera_));
        return hints;
    }
    if (coverage_.fraction() < kEnoughCoverage)
        hints.push_back(
            fmt::format("camera {}: hold the board in {} of the image", camera_, coverage_.emptiest()));
    if (usable() < kEnoughViews)
        hints.push_back(fmt::format("camera {}: {} of {} views; move and tilt the board", camera_, usable(),
                                    kEnoughViews));
    return hints;
}

absl::StatusOr<IntrinsicsResult> IntrinsicsProcedure::solve(const SolveProgress& progress) const {
    const auto report_progress = [&](double fraction, const char* what) {
        return !progress || progress(fraction, fmt::format("camera {}: {}", camera_, what));
    };
    const absl::Status cancelled = absl::CancelledError("stopped; nothing was changed");
    IntrinsicsResult result;
    result.views = views_;

    reject_blurred(edges_px_, options_.max_edge_ratio, result.views);
    IntrinsicsSolver fit(camera_, width_, height_, board_.points(), options_.k3);
    for (int round = 0; round < 3; ++round) {
        if (!report_progress(0.1 + 0.3 * round, round == 0 ? "first fit" : "fit without outliers"))
            return cancelled;
        std::vector<IntrinsicsView*> candidates;
        for (IntrinsicsView& view : result.views)
            if (view.use == ViewUse::kUnused || view.use == ViewUse::kUsed) {
                view.use = ViewUse::kUnused, view.reason.clear();
                candidates.push_back(&view);
            }
        if (candidates.size() < kMinViews)
            return absl::FailedPreconditionError(fmt::format(
                "camera {}: the board is usable in {} of {} images, at least {} are "
                "needed{}; show the whole board in ten or more positions, tilted, still and sharp",
                camera_, candidates.size(), views_.size(), kMinViews,
                hints().empty() || usable() > 0 ? "" : " (" + hints().front() + ")"));
        if (round == 0 && !fit.start(candidates)) break;
        fit.measure_tilts(candidates);

        std::vector<IntrinsicsView*> chosen =
            without_parallel(candidates, Coverage(width_, height_), options_.min_tilt_deg);
        fit.select_informative(chosen, static_cast<std::size_t>(options_.max_views));
        if (!fit.solve(chosen, result)) break;
        if (!reject_outliers(chosen)) {
            fit.measure_unused(result);
            Coverage coverage(width_, height_);
            for (const IntrinsicsView* view : chosen)
                for (const Corner& corner : view->corners) coverage.add(corner.pixel);
            result.coverage = coverage.fraction();
            result.coverage_counts = coverage.counts();
            result.used = static_cast<int>(chosen.size());
            judge(camera_, result, coverage);
            if (!report_progress(1, "done")) return cancelled;
            return result;
        }
    }
    return absl::FailedPreconditionError(fmt::format(
        "camera {}: no intrinsics fit the views; check the board's columns, rows and kind", camera_));
}

}  // namespace kinevox
