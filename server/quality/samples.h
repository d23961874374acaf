// The observed frame sets, and the measurements taken from them. Only for the .cc files of this folder.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "common/camera.h"
#include "server/pose/body_shape.h"
#include "server/quality/measurements.h"
#include "server/quality/observer.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox::quality {

// One camera in one frame set; empty without an image.
struct View {
    cv::Mat grey;        // CV_8U
    cv::Mat foreground;  // CV_8U, 0 or 255, all of it
};

struct Sample {
    std::uint64_t sequence = 0;
    std::vector<View> views;     // per camera
    bool are_separated = false;  // several people, from each other
};

struct Samples {
    std::vector<Camera> cameras;      // of the reduced images
    std::vector<cv::Mat> background;  // per camera, CV_8U, median
    std::vector<Sample> samples;
};

// Per camera the foreground that stays in place, CV_8U, 0 or 255.
std::vector<cv::Mat> measure_still(const Samples& seen, std::vector<CameraMeasurements>& out);
void measure_light(const Samples& seen, std::vector<CameraMeasurements>& out);
// Contours whose edges are in the background's images.
void measure_ghosts(const Samples& seen, std::vector<CameraMeasurements>& out);
// The subject's silhouettes: the foreground without the still one.
SilhouetteSet subject_silhouettes(const Samples& seen, const std::vector<cv::Mat>& still);
void measure_view(const Samples& seen, const SilhouetteSet& subject, std::vector<CameraMeasurements>& out);
void measure_people(const Samples& seen, const std::vector<cv::Mat>& still, Measurements& out);
RigMeasurements measure_rig(const Samples& seen, const SilhouetteSet& subject,
                            std::vector<CameraMeasurements>& out);
WorldMeasurements measure_world(const Samples& seen, const SilhouetteSet& subject);
// Mean silhouette IoU of the posed body, also per camera.
std::optional<double> measure_posed_iou(const Samples& seen, const SilhouetteSet& subject,
                                        std::span<const PosedFrame> poses, const BodyShape& body,
                                        std::vector<CameraMeasurements>& out);

// As measure_view(), of a subject among other people: their silhouettes do not show whom the image border
// cuts.
void measure_posed_view(const std::vector<Camera>& cameras, std::span<const PosedFrame> poses,
                        std::vector<CameraMeasurements>& out);

// Of each pixel; of images of one size, CV_8U, at least one.
cv::Mat median_image(const std::vector<cv::Mat>& images);
// Of values in any order, nearest rank; `otherwise` for none.
double quantile_or(std::vector<double> values, double q, double otherwise);

}  // namespace kinevox::quality
