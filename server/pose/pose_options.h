// Options of the pose stage and its parts.
#pragma once

#include <optional>
#include <string>

#include "kernels/option_list.h"
#include "server/pose/body_shape.h"

namespace kinevox {

struct SilhouetteRayOptions {
    int contour_rays = 160;       // maximum number per camera
    int distance_map_side = 160;  // approximate number of cells along the longer side of the distance map
    int colour_side = 112;  // approximate number of colour cells along the silhouette's longer side; 0: none
    bool operator==(const SilhouetteRayOptions&) const = default;
};

struct PoseCostOptions {
    double contour_std_m = 0.012;    // of a contour ray's distance
    double inside_std_m = 0.012;     // of the distance outside a silhouette
    double term_weight = 0.25;       // weight of one of the correlated neighbouring rays
    double floor_std_m = 0.02;       // of a foot's depth below the floor
    double separation_std_m = 0.02;  // of the penetration of limbs and trunk
    double separation_fraction =
        0.8;  // minimum distance of axes over the sum of the radii: soft tissue and clothes yield
    // Scale of the robust kernel by which the lower foot stands flat on the floor, m, for silhouettes that do
    // not show the feet (BodyFit::standing_m); 0: it need not stand.
    double standing_m = 0;
    bool operator==(const PoseCostOptions&) const = default;
};

struct PoseFitOptions {
    PoseCostOptions cost;
    // Scale of the robust kernel, m: wide first, so that limbs find their silhouettes, then narrow.
    double wide_m = 0.15, narrow_m = 0.04;
    int wide_steps = 3, narrow_steps = 6;  // maximum numbers of accepted or rejected steps
    double done_below = 1e-3;              // minimum relative decrease of the cost per step

    std::string check() const;
    bool operator==(const PoseFitOptions&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, PoseFitOptions>
void visit_options(T& o, F&& f) {
    f({"contour_std_m", 1e-4, 1, "m", "Standard deviation of a contour ray's distance."},
      o.cost.contour_std_m);
    f({"inside_std_m", 1e-4, 1, "m", "Standard deviation of the distance outside a silhouette."},
      o.cost.inside_std_m);
    f({"term_weight", 1e-6, 1, "", "Weight of one of the correlated neighbouring rays."}, o.cost.term_weight);
    f({"floor_std_m", 1e-4, 1, "m", "Standard deviation of a foot's depth below the floor."},
      o.cost.floor_std_m);
    f({"separation_std_m", 1e-4, 1, "m", "Standard deviation of the penetration of limbs and trunk."},
      o.cost.separation_std_m);
    f({"separation_fraction", 0, 2, "", "Fraction of the sum of radii that keeps limbs apart."},
      o.cost.separation_fraction);
    f({"wide_m", 1e-3, 10, "m", "Width of the robust kernel in the first steps."}, o.wide_m);
    f({"narrow_m", 1e-3, 10, "m", "Width of the robust kernel in the last steps."}, o.narrow_m);
    f({"wide_steps", 0, 1000, "", "Maximum number of steps with the wide kernel."}, o.wide_steps);
    f({"narrow_steps", 1, 1000, "", "Maximum number of steps with the narrow kernel."}, o.narrow_steps);
    f({"done_below", 0, 1, "", "Relative decrease of the cost that ends the steps."}, o.done_below);
}

struct PoseTrackerOptions {
    PoseFitOptions fit;
    SilhouetteRayOptions rays;
    int headings = 16;              // tried for each key pose at initialisation
    int starts = 10;                // number of the best of these that are fitted
    int hypotheses = 3;             // number of the best fits that are tracked
    double decide_after_s = 1.0;    // until only the best one is kept
    double drop_cost_ratio = 1.35;  // hypotheses with this multiple of the best cost are dropped at once
    double search_explained_fraction =
        0.9;                           // explained fraction of the contour below which limbs are searched
    bool search_at_start = true;       // limbs of a pose that was just found
    bool always_search_limbs = false;  // below that always; false: only if less than usual is explained
    // Interval of frame sets from which limbs move farther between two of them than a fit finds: every limb
    // and pair is then searched in each frame set. There is the time for it.
    double full_search_interval_s = 0.06;
    double lost_explained_fraction = 0.55;  // explained fraction of the contour below which a pose is lost
    double lost_after_s = 0.15;             // time below that until the tracker is re-initialised
    int min_views = 2;                      // minimum number with a silhouette
    // Standard deviations of accelerations in the motion prior.
    double root_acceleration_m_per_s2 = 15, root_angular_acceleration_rad_per_s2 = 40,
           joint_angular_acceleration_rad_per_s2 = 90;

    std::string check() const;
    bool operator==(const PoseTrackerOptions&) const = default;
};

// Those of the fit are listed there.
template <typename T, typename F>
requires kernels::SameOptions<T, PoseTrackerOptions>
void visit_options(T& o, F&& f) {
    f({"contour_rays", 1, 100000, "", "Maximum number of contour rays per camera."}, o.rays.contour_rays);
    f({"distance_map_side", 1, 10000, "cells", "Longer side of the distance map."}, o.rays.distance_map_side);
    f({"colour_side", 0, 10000, "cells",
       "Longer side of the grid of a subject's colours; 0: colours are not compared."},
      o.rays.colour_side);
    f({"headings", 1, 1000, "", "Headings tried per key pose when a pose is searched."}, o.headings);
    f({"starts", 1, 1000, "", "Number of best starts that are fitted."}, o.starts);
    f({"hypotheses", 1, 1000, "", "Number of best fits that are tracked."}, o.hypotheses);
    f({"decide_after_s", 0, 60, "s", "Time until the best hypothesis is chosen."}, o.decide_after_s);
    f({"drop_cost_ratio", 1, 1e6, "", "Cost relative to the best that drops a hypothesis at once."},
      o.drop_cost_ratio);
    f({"search_explained_fraction", 0, 1, "",
       "Explained fraction of the contour below which limbs are searched."},
      o.search_explained_fraction);
    f({"always_search_limbs", 0, 1, "",
       "Search limbs whenever the explained fraction is below search_explained_fraction, even if that is "
       "usual."},
      o.always_search_limbs);
    f({"full_search_interval_s", 0, 60, "s",
       "Interval of frame sets from which all limbs are searched in each."},
      o.full_search_interval_s);
    f({"lost_explained_fraction", 0, 1, "", "Explained fraction of the contour below which a pose is lost."},
      o.lost_explained_fraction);
    f({"lost_after_s", 0, 60, "s", "Time below that until the pose is searched again."}, o.lost_after_s);
    f({"min_views", 2, 64, "", "Minimum number of cameras with a silhouette."}, o.min_views);
    f({"root_acceleration_m_per_s2", 1e-3, 1e6, "m/s2", "Standard deviation of the root's acceleration."},
      o.root_acceleration_m_per_s2);
    f({"root_angular_acceleration_rad_per_s2", 1e-3, 1e6, "rad/s2",
       "Standard deviation of the root's angular acceleration."},
      o.root_angular_acceleration_rad_per_s2);
    f({"joint_angular_acceleration_rad_per_s2", 1e-3, 1e6, "rad/s2",
       "Standard deviation of the joints' angular acceleration."},
      o.joint_angular_acceleration_rad_per_s2);
}

// One-Euro (Casiez, Roussel & Vogel 2012): a low pass whose cutoff rises with speed, a filter per degree
// of freedom in the tangent space, here of the difference from the posture that the speed so far predicts.
// Causal, for a live stream. Measured with tests/accuracy/live.py.
struct OneEuroOptions {
    double min_cutoff_hz = 18;
    double speed_factor_root = 12;  // added cutoff, Hz per m/s
    double speed_factor_angle = 5;  // added cutoff, Hz per rad/s
    double rate_cutoff_hz = 5;      // of the low pass of the speed

    std::string check() const;
    bool operator==(const OneEuroOptions&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, OneEuroOptions>
void visit_options(T& o, F&& f) {
    f({"min_cutoff_hz", 1e-6, 1e6, "Hz", "Cutoff at rest."}, o.min_cutoff_hz);
    f({"speed_factor_root", 0, 1e6, "Hz per m/s", "Increase of the cutoff with the root's speed."},
      o.speed_factor_root);
    f({"speed_factor_angle", 0, 1e6, "Hz per rad/s", "Increase of the cutoff with angular speed."},
      o.speed_factor_angle);
    f({"rate_cutoff_hz", 1e-6, 1e6, "Hz", "Cutoff of the speed's own low pass."}, o.rate_cutoff_hz);
}

struct EstimateOptions {
    // Beyond these standard deviations a value is withheld.
    double max_joint_std_m = 0.10;
    double max_angle_std_rad = 0.45;
    // Standard deviation of the joints by a body that is not the subject's; 0: the subject's.
    double body_std_m = 0;
    // Added to the log odds of a limb that is somewhere else than the fit has put it.
    double gross_log_odds = 0;
    bool operator==(const EstimateOptions&) const = default;
};

// With which the poses are found.
struct BodyInUse {
    BodyShape shape = default_body_shape();
    double standing_m = 0;  // as in PoseCostOptions
    double std_m = 0;       // as EstimateOptions::body_std_m
};

struct PoseStageOptions {
    PoseTrackerOptions tracker;
    EstimateOptions estimate;
    OneEuroOptions filter;
    bool filtered = true;  // by the causal filter above; off for recordings, which are smoothed without delay
    // Fraction of a silhouette outside the volume's main body above which the silhouette is masked by it.
    double max_outside_fraction = 0.2;
    int candidates = 5;  // number requested from the proposer when a pose must be found
    BodyShape body = default_body_shape();
    double body_std_m = 0.018;  // as EstimateOptions::body_std_m, here of an adult of average build

    // The subject's own body.
    void set_body(const BodyShape& known) { body = known, body_std_m = 0; }
    BodyInUse initial_body() const { return {body, tracker.fit.cost.standing_m, body_std_m}; }
    // Empty when valid, else one sentence.
    std::string check() const;
    bool operator==(const PoseStageOptions&) const = default;
};

// Those of the tracker and the filter are listed there; the body is no option by name.
template <typename T, typename F>
requires kernels::SameOptions<T, PoseStageOptions>
void visit_options(T& o, F&& f) {
    f({"filtered", 0, 1, "", "Smooth poses over time, causally."}, o.filtered);
    f({"max_outside_fraction", 0, 1, "",
       "Fraction of a silhouette outside the volume above which it is masked."},
      o.max_outside_fraction);
    f({"candidate_count", 0, 1000, "", "Number of poses requested from the pose database."}, o.candidates);
    f({"max_joint_std_m", 1e-4, 10, "m", "Standard deviation above which a joint is withheld."},
      o.estimate.max_joint_std_m);
    f({"max_angle_std_rad", 1e-4, 10, "rad", "Standard deviation above which an angle is withheld."},
      o.estimate.max_angle_std_rad);
}

struct BodyFitOptions {
    int max_frames = 40;  // maximum number used, evenly chosen
    int size_frames = 4;  // in which bodies of several sizes are tried first
    int rounds = 2;       // of tracking and fitting
    bool quick = false;   // takes postures as they are tracked, and does not search limbs to compare sizes
    int steps = 10;       // each with a wide and a narrow kernel
    double independent_frames = 4;    // maximum effective number of independent frames
    double stature_std_m = 0.12;      // around the mean adult
    std::optional<double> stature_m;  // measured
    // Minimum explained fraction of the contour of a pose that is used; lower than for tracking, since
    // separate clips often have a poorer background.
    double min_explained_fraction = 0.25;

    std::string check() const;
};

}  // namespace kinevox
