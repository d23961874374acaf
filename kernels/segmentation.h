// Background subtraction by kernel density estimation, one Segmenter a camera (paper 3.1, after Elgammal
// 2000).
//
//   pdf(I_t) = 1/N * sum_i K(I_t - I_i),   K a Gaussian per channel, bandwidth per pixel and channel.
//
// From the density comes a foreground probability per pixel and two silhouettes: a sharp one (for the pose)
// and a loose one (for the volume), since no single threshold serves both (paper 5).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels {

struct SegmentationOptions {
    // Samples of the background model per pixel (N), short-term and long-term memory together; 1..255.
    int samples = 32;
    // Bandwidths are never smaller than this: grey levels, one standard deviation; 1..32. Compressed video
    // shows less noise from one picture to the next than over a minute, so the measured noise alone is too
    // small.
    float min_bandwidth = 2.5f;
    // The bandwidth where the background was learned from fewer than five pictures, grey levels; 1..32.
    float assumed_noise = 3.0f;

    // Every how many frames a pixel of the background takes a new sample into its short-term memory (a
    // quarter of the samples); 0 freezes the model.
    int update_interval = 32;
    // Every how many of those samples one goes into the long-term memory (the other three quarters).
    int long_term_interval = 8;
    // Frames after which something that does not move and is not the tracked subject has become background.
    int absorb_frames = 600;

    // Darkest shadow and brightest light that are still background, as factors of the background's
    // brightness.
    float darkest_shadow = 0.35f;
    float brightest_light = 1.25f;
    // Part of the background that is expected in a changed light, 0..1 exclusive. Smaller: less of the
    // subject is taken for shadow; larger: less shadow is taken for the subject.
    float light_change_prior = 0.1f;

    // How much the colours seen on the subject before count against colours never seen, 0..1; 0 does without.
    float colour_memory_share = 0.7f;

    // Foreground probability from which a pixel belongs to the sharp and to the loose silhouette, 0..1
    // exclusive.
    float sharp_threshold = 0.5f;
    float loose_threshold = 0.3f;
    // Unmixes the pixels at the border, so that the sharp silhouette ends where half a pixel is the subject.
    bool refine_border = true;
    // Islands of fewer pixels, or of less than this part of the largest one, are dropped.
    int min_island_px = 30;
    float min_island_part = 0.04f;
    // Holes of fewer pixels, or of less than this part of the largest island, are filled.
    int max_hole_px = 60;
    float max_hole_part = 0.003f;

    // Empty when the options are usable, else one sentence: which field, its value, what is allowed.
    std::string check() const;
};

// What the tracker expects in this picture; everything may be absent.
struct SegmentationPrior {
    // Where the tracked subject can be, with its margin. Empty: nothing is tracked, the whole picture is
    // searched.
    Rect region;
    // True asks for the whole picture although a region is given (so that a newcomer is caught).
    bool full_pass = true;
    // The last volume's projection moved to where the subject is expected: width * height bytes, 255 inside,
    // or null. Islands of foreground that do not touch it are dropped when `region` is set.
    const std::uint8_t* expected = nullptr;
    // How far from `expected` the subject can be, px; farther cells of the region need not be looked at.
    // Negative: anywhere in the region. A device may look at them all the same.
    int reach_px = -1;
};

// All three pictures have the camera's full size, rows without padding; outside `searched` they are 0.
struct Silhouettes {
    int width = 0, height = 0;
    std::vector<std::uint8_t> probability;  // of foreground, 0..255 for 0..1
    std::vector<std::uint8_t> sharp;        // 0 or 255
    std::vector<std::uint8_t> loose;        // 0 or 255, contains `sharp`
    Rect searched;                          // the part of the picture that was looked at
    Rect bounds;                            // smallest box around `loose`, empty if there is no foreground
    std::int64_t sharp_pixels = 0;
    double centroid_x = 0, centroid_y = 0;  // centre of gravity of `sharp`, px; valid if sharp_pixels > 0
};

// The background model of one camera and its use. Not thread safe; different cameras' segmenters may run at
// once.
class Segmenter {
  public:
    virtual ~Segmenter() = default;

    // Fills the model from pictures of the empty scene, at least one, all of the segmenter's size; with a
    // single picture the sensor's noise is assumed. Replaces what was learned before.
    virtual void learn(std::span<const PictureView> empty_scene) = 0;
    virtual bool learned() const = 0;

    // Segments one picture and updates the model. `out` is reused from call to call to spare the allocation.
    // Throws std::invalid_argument for a picture of another size, std::logic_error before learn().
    virtual void segment(const PictureView& picture, const SegmentationPrior& prior, Silhouettes& out) = 0;
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent.
std::unique_ptr<Segmenter> make_segmenter(Device device, int width, int height, int channels,
                                          const SegmentationOptions& options = {});

}  // namespace kinevox::kernels
