// The virtual studio: a person, a motion, a room, cameras and a sensor; a picture for every camera and frame,
// and what is true in it. The same options and the same frame give the same bits.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/skeleton.h"
#include "server/cameras/frame_source.h"
#include "server/cameras/studio/staging.h"

namespace kinevox::studio {

struct StudioOptions {
    std::string motion = "walk";      // one of kMotionNames (motion.h)
    std::string stage = "auto";       // "room", "lane", or "auto": what suits the motion
    int cameras = 4;                  // on a ring around the room's middle or the lane; 1 .. 64
    int width = 640, height = 480;    // px of every camera; 64 .. 4096
    double fps = 30;                  // frame sets a second; 1 .. 1000
    std::uint32_t seed = 1;           // person, clothes, room, cameras' places, noise
    double subject_height_m = 0;      // 1.2 .. 2.2, or 0: drawn from the seed
    double noise_grey = 1.4;          // standard deviation of the sensor's noise, grey levels; 0 .. 50
    double flicker = 0.02;            // the light's relative amplitude; 0 .. 0.3
    double distortion = 0;            // k1 of the lenses (k2, p1, p2 follow from it); -0.3 .. 0.3
    std::vector<Camera> own_cameras;  // used instead of the ring where not empty
    Staging staging;                  // a board, a wand, a knocked camera, nobody

    // Empty when usable, else one sentence.
    std::string check() const;
};

struct SubjectTruth {
    std::array<Vec3, kJointNames.size()> joints_in_world;  // m, in the order of kJointNames
};

class Studio {
  public:
    static absl::StatusOr<std::unique_ptr<Studio>> create(const StudioOptions& options);
    virtual ~Studio() = default;

    virtual const StudioOptions& options() const = 0;
    virtual const std::vector<Camera>& cameras() const = 0;
    // After so many frames the motion begins anew with a jump in place; 0: never.
    virtual std::int64_t frames_per_loop() const = 0;
    // One sentence about person, room and motion.
    virtual std::string description() const = 0;

    // All cameras' pictures (B G R) of a frame >= 0. Cameras are drawn in parallel where `parallel`.
    // Not thread safe: drawing buffers are kept from call to call.
    virtual std::vector<Picture> draw(std::int64_t frame, bool parallel) = 0;
    // The empty room before anything happened, noise and flicker of its own.
    virtual Picture draw_empty(std::size_t camera, std::int64_t frame) const = 0;

    // The camera as it stands at a frame: another one than in cameras() after it was knocked.
    virtual const Camera& camera_at(std::size_t camera, std::int64_t frame) const = 0;
    // Of board or wand; the identity where there is none.
    virtual Rigid3 world_from_prop(std::int64_t frame) const = 0;

    virtual SubjectTruth truth(std::int64_t frame) const = 0;
    // Per camera, height * width values 0 or 255: whether the ray through the pixel's centre hits the person.
    virtual std::vector<std::vector<std::uint8_t>> masks(std::int64_t frame) = 0;
    // The person's closed surface, m in the world, and its triangles (counter-clockwise from outside).
    struct Surface {
        std::vector<Vec3> vertices;
        std::vector<std::array<std::uint32_t, 3>> triangles;
    };
    virtual Surface surface(std::int64_t frame) = 0;
};

// Cameras on an ellipse around what happens, looking at it, focal lengths such that all of it is in every
// picture.
std::vector<Camera> ring_of_cameras(const StudioOptions& options, bool lane);

}  // namespace kinevox::studio
