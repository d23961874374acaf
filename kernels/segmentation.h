// Background subtraction by kernel density estimation, one Segmenter per camera (paper 3.1, after Elgammal
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

#include "kernels/device_context.h"
#include "kernels/option_list.h"
#include "kernels/types.h"

namespace kinevox::kernels {

namespace kde {
struct SceneView;
}

struct SegmentationOptions {
    // Samples of the background model per pixel (N), short-term and long-term memory together; 1..255.
    int samples = 32;
    // Minimum bandwidth: grey levels (sigma); 1..32. Compressed video has less noise between consecutive
    // images than over a minute, so that the measured noise alone is too small.
    float min_bandwidth = 2.5f;
    // Bandwidth if the background was learned from fewer than five images, grey levels; 1..32.
    float assumed_noise = 3.0f;

    // Interval in frames at which a background pixel adds a sample to its short-term memory (a quarter of the
    // samples); 0 freezes the model.
    int update_interval = 32;
    // Every Nth of these samples enters the long-term memory (the other three quarters).
    int long_term_interval = 8;
    // Frames after which a static object that is not the tracked subject becomes background.
    int absorb_frames = 600;

    // Darkest shadow and brightest light that are still background, as factors of the background's
    // brightness.
    float darkest_shadow = 0.35f;
    float brightest_light = 1.25f;
    // Expected fraction of the background in changed light, 0..1 exclusive. Smaller values misclassify less
    // of the subject as shadow, larger values less shadow as the subject.
    float light_change_prior = 0.1f;

    // Judges blocks of pixels, too, that differ from the background by little more than the camera's noise:
    // finds clothes in the background's colours, but may take weak shadows for the subject.
    bool judge_faint = false;

    // Weight of colours seen on the subject before against unseen colours, 0..1; 0: off.
    float colour_memory_weight = 0.7f;

    // Minimum foreground probability of the sharp and of the loose silhouette, 0..1 exclusive.
    float sharp_threshold = 0.5f;
    float loose_threshold = 0.3f;
    // Unmixes border pixels, so that the sharp silhouette ends where half a pixel is the subject.
    bool refine_border = true;
    // Components of fewer pixels, or below this fraction of the largest one, are removed.
    int min_component_px = 30;
    float min_component_fraction = 0.04f;
    // Holes of fewer pixels, or below this fraction of the largest component, are filled.
    int max_hole_px = 60;
    float max_hole_fraction = 0.003f;

    // Empty when the options are usable, else one sentence: which field, its value, what is allowed.
    std::string check() const;
    bool operator==(const SegmentationOptions&) const = default;
};

template <typename T, typename F>
requires SameOptions<T, SegmentationOptions>
void visit_options(T& o, F&& f) {
    f({"background_samples", 1, 255, "", "Background samples per pixel."}, o.samples);
    f({"min_bandwidth", 1, 32, "grey levels", "Minimum bandwidth of the density estimate."}, o.min_bandwidth);
    f({"assumed_noise", 1, 32, "grey levels", "Bandwidth with fewer than five background images."},
      o.assumed_noise);
    f({"update_interval", 0, 100000, "frames", "Interval of new background samples per pixel; 0: never."},
      o.update_interval);
    f({"long_term_interval", 1, 100000, "", "Every Nth of these samples enters the long-term memory."},
      o.long_term_interval);
    f({"absorb_frames", 1, 100000000, "frames", "Time until a static object becomes background."},
      o.absorb_frames);
    f({"darkest_shadow", 0.05, 1, "", "Brightness factor of the darkest shadow that is background."},
      o.darkest_shadow);
    f({"brightest_light", 1, 4, "", "Brightness factor of the brightest light that is background."},
      o.brightest_light);
    f({"light_change_prior", 1e-9, 1 - 1e-4, "", "Expected fraction of the background in changed light."},
      o.light_change_prior);
    f({"judge_faint", 0, 1, "", "Judge blocks that differ faintly from the background."}, o.judge_faint);
    f({"colour_memory_weight", 0, 1 - 1e-4, "", "Weight of colours seen on the subject; 0: off."},
      o.colour_memory_weight);
    f({"sharp_threshold", 1e-4, 1 - 1e-4, "", "Foreground probability of the sharp silhouette."},
      o.sharp_threshold);
    f({"loose_threshold", 1e-4, 1 - 1e-4, "", "Foreground probability of the loose silhouette."},
      o.loose_threshold);
    f({"refine_border", 0, 1, "", "Unmix the pixels at the border of the sharp silhouette."},
      o.refine_border);
    f({"min_component_px", 0, 1e9, "px", "Smaller components are removed."}, o.min_component_px);
    f({"min_component_fraction", 0, 1, "", "Components below this fraction of the largest are removed."},
      o.min_component_fraction);
    f({"max_hole_px", 0, 1e9, "px", "Smaller holes are filled."}, o.max_hole_px);
    f({"max_hole_fraction", 0, 1, "", "Holes below this fraction of the largest component are filled."},
      o.max_hole_fraction);
}

// The tracker's expectation for this image; all of it is optional.
struct SegmentationPrior {
    // Where the tracked subject can be, including a margin. Empty: nothing is tracked, the whole image is
    // searched.
    Rect region;
    // True: searches the whole image despite the region (to detect new subjects).
    bool full_pass = true;
    // Projection of the last volume at the expected position: width * height bytes, 255 inside, or null. If
    // `region` is set, components of the foreground that do not touch it are removed.
    const std::uint8_t* expected = nullptr;
    // Maximum distance of the subject from `expected`, px; cells of the region farther away need not be
    // searched, but may be. Negative: no limit.
    int max_distance_px = -1;
};

// All three images have the camera's full size, rows without padding; outside `searched` they are 0.
struct Silhouettes {
    int width = 0, height = 0;
    std::vector<std::uint8_t> probability;  // of foreground, 0..255 for 0..1
    std::vector<std::uint8_t> sharp;        // 0 or 255
    std::vector<std::uint8_t> loose;        // 0 or 255, contains `sharp`
    Rect searched;                          // the part of the image that was searched
    Rect bounds;                            // bounding box of `loose`, empty without foreground
    std::int64_t sharp_pixels = 0;
    double centroid_x = 0, centroid_y = 0;  // centroid of `sharp`, px; valid if sharp_pixels > 0
};

class Segmenter;

// What decide() needs of one camera of a frame set.
struct FrameDecision {
    Segmenter* segmenter = nullptr;
    std::vector<const Segmenter*> others;
};

// Segments the images of one camera. Not thread-safe; the segmenters of several cameras may run in parallel.
class Segmenter {
  public:
    virtual ~Segmenter() = default;

    // Learns the model from background images, at least one, all of the segmenter's size; with fewer than
    // five the noise is assumed. Replaces the previous model.
    virtual void learn(std::span<const ImageView> empty_scene) = 0;
    virtual bool learned() const = 0;

    // Replaces SegmentationOptions::judge_faint from the next frame on.
    virtual void set_judge_faint(bool judge) = 0;

    // The camera in the world frame, z up, the floor at z = 0; without it, shadows are judged from this
    // camera's image alone. Throws std::invalid_argument for an unusable camera.
    virtual void set_camera(const CameraModel& camera) = 0;

    // A frame in three steps, each for all cameras before the next one: decide() compares shadows with the
    // images and models of `others`, segmenters of the same device and context that have begun a frame of
    // the same instant. `image` and `prior` must stay valid until end_frame(). Reuses the memory of `out`.
    // Throws std::invalid_argument for an image of another size, std::logic_error before learn().
    virtual void begin_frame(const ImageView& image, const SegmentationPrior& prior) = 0;
    virtual void decide(std::span<const Segmenter* const> others, Silhouettes& out) = 0;
    // Between begin_frame() and decide() of all cameras of a frame set, of any one of them: a GPU then works
    // on all at once, and each decide(), with the same `others`, only returns what was found.
    virtual void decide_together(std::span<const FrameDecision>) {}
    // Updates the model with the frame; `out` as decide() filled it.
    virtual void end_frame(const Silhouettes& out) = 0;

    // The pixels of `image`, rows without padding, in a GPU's memory if they are those of the last
    // begin_frame(), and until the next one; null on the CPU. Valid after decide().
    virtual const std::uint8_t* image_on_device(const ImageView&) const { return nullptr; }

    // The three steps for one camera alone.
    void segment(const ImageView& image, const SegmentationPrior& prior, Silhouettes& out) {
        begin_frame(image, prior);
        decide({}, out);
        end_frame(out);
    }

    // What other segmenters' decide() looks up; valid from begin_frame() to end_frame(). Null without a
    // camera.
    virtual const kde::SceneView* scene() const = 0;
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent. `context`: of the device, which the segmenters of a StageFactory share; null: one of its own, so
// that a GPU cannot compare its frames with those of others.
std::unique_ptr<Segmenter> make_segmenter(Device device, int width, int height, int channels,
                                          const SegmentationOptions& options = {},
                                          std::shared_ptr<DeviceContext> context = {});

}  // namespace kinevox::kernels
