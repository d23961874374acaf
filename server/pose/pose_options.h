// Options of the pose stage and its parts.
#pragma once

#include <string>

#include "server/pose/body_shape.h"

namespace kinevox {

struct SilhouetteRayOptions {
    int contour_rays = 160;  // at most so many a camera
    int distance_map_side =
        160;  // the distance map is coarsened to about so many cells along its longer side
};

struct PoseCostOptions {
    double contour_std_m = 0.012;  // of a contour ray's distance
    double inside_std_m = 0.012;   // of how far a part sticks out of a silhouette
    double term_weight = 0.25;  // neighbouring rays err alike: one counts as this part of an independent one
    double floor_std_m = 0.02;  // of how far a foot goes below the floor
    double apart_std_m = 0.02;  // of how far limbs enter the trunk or each other
    double apart_share = 0.8;   // of the radii's sum that axes keep apart: flesh and clothes give way
};

struct PoseFitOptions {
    PoseCostOptions cost;
    // Distances that still count, m: wide first, so that limbs find their silhouettes, then narrow.
    double wide_m = 0.15, narrow_m = 0.04;
    int wide_steps = 3, narrow_steps = 6;  // at most so many accepted or rejected steps
    double done_below = 1e-3;              // relative decrease of the cost that ends a stage

    std::string check() const;
};

struct PoseTrackerOptions {
    PoseFitOptions fit;
    SilhouetteRayOptions rays;
    int headings = 16;            // tried for each key pose at the beginning
    int starts = 10;              // of all those the best are fitted
    int hypotheses = 3;           // and of these so many are followed
    double decide_after_s = 1.0;  // then the best one alone
    double hopeless = 1.35;       // a rival whose cost is so many times the best one's is dropped at once
    double search_below =
        0.9;               // part of the contour explained; below it a limb is searched for each frame set
    bool patient = false;  // searches below that always, not only where less than usual is explained
    double lost_below = 0.55;    // part of the contour explained; below it a pose is lost
    double lost_after_s = 0.15;  // for so long, and the search begins anew
    int min_views = 2;           // with a silhouette
    // Accelerations that the motion prior expects, one standard deviation.
    double root_acceleration_m_s2 = 15, root_turn_rad_s2 = 40, joint_turn_rad_s2 = 90;

    std::string check() const;
};

// One-Euro (Casiez, Roussel & Vogel 2012): a low pass whose cutoff rises with speed, a filter a degree of
// freedom in the tangent space. Causal, for a live stream.
struct OneEuroOptions {
    double min_cutoff_hz = 4;
    double speed_factor_root = 6;   // added cutoff, Hz per m/s
    double speed_factor_angle = 2;  // added cutoff, Hz per rad/s
    double rate_cutoff_hz = 2;      // of the low pass of the speed

    std::string check() const;
};

struct EstimateOptions {
    // Beyond these standard deviations a value is withheld.
    double max_joint_std_m = 0.10;
    double max_angle_std_rad = 0.45;
};

struct PoseStageOptions {
    PoseTrackerOptions tracker;
    EstimateOptions estimate;
    OneEuroOptions filter;
    bool filtered = true;  // by the causal filter above; off for recordings, which are smoothed as a whole
    // Part of a silhouette that may lie outside of the volume's main part; where it is more, the silhouette
    // is cut there.
    double max_outside_volume = 0.2;
    int candidates = 5;  // asked of the proposer where a body must be found
    BodyShape body = default_body_shape();

    // Empty when usable, else one sentence.
    std::string check() const;
};

struct BodyFitOptions {
    int max_frames = 40;            // of those given, evenly chosen
    int rounds = 2;                 // of tracking and fitting
    int steps = 10;                 // each with a wide and a narrow kernel
    double independent_frames = 1;  // all frames together count as so many
    double stature_std_m = 0.12;    // around the mean adult
    // Part of the contour that a pose must explain to be used: less than the tracker asks, since a clip of
    // its own often has a poorer background.
    double min_explained = 0.25;

    std::string check() const;
};

}  // namespace kinevox
