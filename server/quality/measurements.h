// What the judges of a result look at: plain numbers, of a whole session or of the last seconds of a live
// capture.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace kinevox::quality {

// Of one camera, over the observed frame sets. Absent: could not be measured.
struct CameraMeasurements {
    std::string name;

    // Images.
    double mean_level = 128;         // grey levels, 0..255, median over the frame sets
    double dark_fraction = 0;        // of the pixels, at or below kDarkLevel
    double saturated_fraction = 0;   // of the pixels, at or above kSaturatedLevel
    double foreground_fraction = 0;  // of the image, median

    // Silhouettes.
    double seen_fraction = 1;       // of the frame sets, with a silhouette of a person's size
    double truncated_fraction = 0;  // of the frame sets, cut by the image border
    // Area of foreground that stays in place with a sharp contour while other foreground moves, over the
    // median area of the moving foreground.
    double still_area_ratio = 0;
    // Fraction of that foreground's contour whose edges are in the background's images, not in the current
    // ones: it was there while the background was learned.
    double still_in_background_fraction = 0;
    // The same fraction for all of the foreground's contours.
    double ghost_contour_fraction = 0;

    std::optional<double> hull_iou;   // of the silhouette and the hull of the other cameras' silhouettes
    std::optional<double> posed_iou;  // of the silhouette and the posed body
};

// Consistency of the silhouettes under one hypothesis about the rig; residuals in px.
struct RigHypothesis {
    std::size_t camera = 0;
    double residual_px = 0;  // if the hypothesis is true
    // What it assumes.
    double rotated_deg = 0, moved_m = 0;  // camera moved
    double focal_factor = 1;              // intrinsics
    double shift_frames = 0;              // time: images of this camera are later than the others'
    std::size_t other = 0;                // swapped with
};

struct RigMeasurements {
    std::optional<double> hull_iou, min_hull_iou;  // mean over the cameras, worst camera
    // Worst camera of each frame set, 10th percentile: cameras of different times show it only in movement.
    std::optional<double> low_hull_iou;
    std::optional<double> residual_px;  // of the given calibration
    double side_px = 640;               // the longer side of the images the residuals refer to
    // The best of each kind; only measured if the residual is large, `time` also if some frame sets disagree.
    std::optional<RigHypothesis> swapped, moved, intrinsics, all_intrinsics, time;
};

struct WorldMeasurements {
    // Direction of up from the cameras' horizontal image rows, against the world's z; absent if the cameras'
    // rolls contradict each other or the subject, who is upright in the world, contradicts a few cameras.
    std::optional<double> tilt_deg;
    double cameras_below_fraction = 0;       // of the cameras, below the floor
    std::optional<double> subject_tilt_deg;  // from the feet to the centre, against z, median
    std::optional<double> lowest_m;          // z of the subject's lowest point, median
    std::optional<double> volume_litres;     // of the tracked volume, median
    std::optional<double> max_height_m;      // of the hull, 90th percentile
    std::optional<double> subject_height_m;  // of the silhouettes' hull, arms included, median
};

struct BodyMeasurements {
    std::optional<double> stature_m;         // of the body that was used
    bool given = false;                      // from a file or a T-pose session, not fitted to the movement
    std::optional<double> fitted_stature_m;  // fitted to the movement, if another body was given
    bool feet_unseen = false;                // the fitted body stands on the floor without them
    std::optional<double> residual_m, fitted_residual_m;  // contour residual with each body, RMS
};

struct PoseMeasurements {
    double subject_fraction = 0;               // of the frame sets, with a tracked subject
    double posed_fraction = 0;                 // of these, with a pose
    double withheld_fraction = 0;              // of the joints of all poses
    std::optional<double> joint_std_m;         // stated, median
    std::optional<double> contour_residual_m;  // RMS, median
    std::optional<double> posed_iou;           // mean over cameras and frame sets
    std::optional<double> lowest_m;            // z of the lowest measured ankle or toe, median
};

struct Measurements {
    int frame_sets = 0;  // observed
    std::vector<CameraMeasurements> cameras;
    // Fraction of the frame sets with more than one separate body of a person's size.
    double several_people_fraction = 0;
    double merged_people_fraction = 0;  // and none of them separated from the subject
    int followed_subjects = 1;          // each with a pose of its own
    bool subjects_selected = false;     // by rules that exclude others
    std::uint32_t subject_id = 0;       // whose body and pose follow; 0: the only one's
    std::string subject_name;           // empty: none
    RigMeasurements rig;
    WorldMeasurements world;
    BodyMeasurements body;
    PoseMeasurements pose;
};

inline constexpr int kDarkLevel = 12, kSaturatedLevel = 250;

}  // namespace kinevox::quality
