// One person of the virtual studio: body, motion, and the meshes in the pose of a frame.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>

#include "server/cameras/studio/body_mesh.h"
#include "server/cameras/studio/motion.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::studio {

// The first person of `options`.
PersonOptions first_person(const StudioOptions& options);

class Person {
  public:
    // InvalidArgument for an unknown motion.
    static absl::StatusOr<std::unique_ptr<Person>> create(const PersonOptions& options, double fps,
                                                          const std::string& stage);

    // Number of frames after which the motion restarts; 0: never.
    std::int64_t frames_per_loop() const;
    bool is_present(std::int64_t frame) const;
    std::array<Vec3, kJointNames.size()> joints(std::int64_t frame) const {
        return rig_.joints(rig_.forward(pose(frame)));
    }
    const Subject& subject() const { return subject_; }
    const BodyMesh& mesh() const { return mesh_; }
    const BodyMesh& caster() const { return caster_; }  // of shadows
    void skin_mesh(std::int64_t frame, SkinnedBody& out) const {
        skin(mesh_, rest_, rig_.forward(pose(frame)), out);
    }
    void skin_caster(std::int64_t frame, SkinnedBody& out) const {
        skin(caster_, rest_, rig_.forward(pose(frame)), out);
    }

  private:
    Person(const PersonOptions& options, double fps);
    Pose pose(std::int64_t frame) const;

    PersonOptions options_;
    double fps_;
    Subject subject_;
    Rig rig_;
    PosedRig rest_;
    ImplicitBody body_;
    std::unique_ptr<Motion> motion_;
    BodyMesh mesh_, caster_;
};

// The meshes of several people as one, with the label of each triangle: 1 + the person's number.
class PeopleMesh {
  public:
    // `casters`: the meshes that cast shadows instead.
    void set(const std::vector<std::unique_ptr<Person>>& people, std::int64_t frame, bool casters);
    const BodyMesh& mesh() const { return mesh_; }
    const SkinnedBody& skinned() const { return skinned_; }
    const std::vector<std::uint8_t>& labels() const { return labels_; }
    bool empty() const { return skinned_.vertices.empty(); }

  private:
    std::vector<std::size_t> present_;  // people in mesh_
    bool built_ = false;
    BodyMesh mesh_;
    SkinnedBody skinned_, one_;
    std::vector<std::uint8_t> labels_;
};

}  // namespace kinevox::studio
