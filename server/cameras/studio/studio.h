// The virtual studio: renders a moving person in a room for every camera and frame, with ground truth. The
// same options and frame give the same bits.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/body_table.h"
#include "common/camera.h"
#include "server/cameras/frame_source.h"
#include "server/cameras/studio/rig.h"
#include "server/cameras/studio/room.h"
#include "server/cameras/studio/staging.h"

namespace kinevox::studio {

// A camera that is placed by hand; it aims at the centre of the capture space.
struct PlacedCamera {
    Vec3 position_in_world;                         // m, within the room
    int width = 640, height = 480;                  // px; 64 .. 4096
    double zoom = 1;                                // 1: just shows all of the capture space; 0.3 .. 3
    double roll_deg = 0;                            // about the optical axis; -180 .. 180
    Vec3 aim_offset;                                // m, of the point that it aims at
    double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;  // each -0.5 .. 0.5

    // Empty when usable, else one sentence.
    std::string check() const;
};

// A further person; the first one is described by StudioOptions itself.
struct PersonOptions {
    std::string motion = "walk";
    std::uint32_t seed = 1;
    double stature_m = 0;
    double motion_speed = 1, motion_start_s = 0, motion_yaw_deg = 0;
    Vec3 motion_shift;  // m; z must be 0
    SubjectOptions subject;
    // s; outside of these times the person is not there. Negative: from the start, to the end, and never
    // again.
    double enter_s = -1, leave_s = -1, return_s = -1;

    // Empty when usable, else one sentence.
    std::string check() const;
};

struct StudioOptions {
    std::string motion = "walk";    // one of kMotionNames (motion.h)
    std::string stage = "auto";     // "room", "lane", or "auto": what suits the motion
    int cameras = 4;                // on a ring around the centre of the room or the lane; 1 .. 64
    int width = 640, height = 480;  // px of every camera; 64 .. 4096
    double fps = 30;                // frame sets per second; 1 .. 1000
    std::uint32_t seed = 1;         // of person, clothes, room, camera poses, noise
    double stature_m = 0;           // 1.2 .. 2.2, or 0: drawn from the seed
    double noise_grey = 1.4;        // sensor noise (one sigma), grey levels; 0 .. 50
    double flicker = 0.02;          // relative amplitude of the light; 0 .. 0.3
    double distortion = 0;          // k1 of the lenses (k2, p1, p2 follow from it); -0.3 .. 0.3
    double shot_noise_grey = 0;     // noise of the light itself at white, one sigma, grey levels; 0 .. 20
    double motion_speed = 1;        // times the motion's own; 0.2 .. 3
    double motion_start_s = 0;      // time of the motion in frame 0, s; 0 .. 100
    double motion_yaw_deg = 0;      // the motion is rotated about the vertical, then shifted
    Vec3 motion_shift;              // m; z must be 0
    SubjectOptions subject;
    double enter_s = -1, leave_s = -1, return_s = -1;  // as PersonOptions
    std::vector<PersonOptions> others;
    RoomOptions room;
    LightOptions light;
    std::vector<PlacedCamera> placed_cameras;  // if not empty: used instead of the ring
    std::vector<Camera> custom_cameras;        // if not empty: used instead of either
    Staging staging;                           // person, calibration target, bumped camera

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
    // Number of frames after which the motion restarts with a jump in position; 0: never.
    virtual std::int64_t frames_per_loop() const = 0;
    // One sentence about person, room and motion.
    virtual std::string description() const = 0;

    // The images (B G R) of all cameras for a frame >= 0. `parallel`: renders the cameras in parallel. Not
    // thread-safe: keeps its buffers.
    virtual std::vector<Image> draw(std::int64_t frame, bool parallel) = 0;
    // The empty room before the first frame, with independent noise and flicker.
    virtual Image draw_empty(std::size_t camera, std::int64_t frame) const = 0;

    // The true camera in a frame: differs from cameras() after a bump.
    virtual const Camera& camera_at(std::size_t camera, std::int64_t frame) const = 0;
    // Pose of the target; the identity if there is none.
    virtual Rigid3 world_from_target(std::int64_t frame) const = 0;

    virtual std::size_t person_count() const = 0;
    virtual bool is_present(std::size_t person, std::int64_t frame) const = 0;
    virtual SubjectTruth truth(std::int64_t frame, std::size_t person = 0) const = 0;
    // Per camera, height * width values: 1 + the person that the ray through the pixel's centre hits first;
    // 0: none.
    virtual std::vector<std::vector<std::uint8_t>> labels(std::int64_t frame) = 0;
    // The same as 0 or 255: whether it hits anybody.
    std::vector<std::vector<std::uint8_t>> masks(std::int64_t frame);
    // The first person's closed surface, m in the world, and its triangles (counter-clockwise from outside).
    struct Surface {
        std::vector<Vec3> vertices;
        std::vector<std::array<std::uint32_t, 3>> triangles;
    };
    virtual Surface surface(std::int64_t frame) = 0;
};

// placed_cameras with the focal lengths and directions that show the capture space.
std::vector<Camera> cameras_as_placed(const StudioOptions& options, bool lane);

// Cameras on an ellipse around the capture space, aimed at it, with focal lengths that show all of it.
std::vector<Camera> ring_of_cameras(const StudioOptions& options, bool lane);

}  // namespace kinevox::studio
