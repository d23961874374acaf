#include "server/cameras/studio/person.h"

#include <cmath>
#include <utility>

namespace kinevox::studio {

PersonOptions first_person(const StudioOptions& options) {
    return {.motion = options.motion,
            .seed = options.seed,
            .stature_m = options.stature_m,
            .motion_speed = options.motion_speed,
            .motion_start_s = options.motion_start_s,
            .motion_yaw_deg = options.motion_yaw_deg,
            .motion_shift = options.motion_shift,
            .subject = options.subject,
            .enter_s = options.enter_s,
            .leave_s = options.leave_s,
            .return_s = options.return_s};
}

Person::Person(const PersonOptions& options, double fps)
    : options_(options),
      fps_(fps),
      subject_(make_subject(options.seed, options.stature_m, options.subject)),
      rig_(subject_),
      rest_(rig_.forward(rig_.rest_pose())),
      body_(rig_, subject_),
      mesh_(make_body_mesh(body_, subject_, {})),
      caster_(make_body_mesh(body_, subject_, {.cell_m = 0.032f, .painted = false})) {}

absl::StatusOr<std::unique_ptr<Person>> Person::create(const PersonOptions& options, double fps,
                                                       const std::string& stage) {
    std::unique_ptr<Person> person(new Person(options, fps));
    auto motion = make_motion(options.motion,
                              stage == "auto"   ? natural_stage(options.motion)
                              : stage == "lane" ? Stage::kLane
                                                : Stage::kRoom,
                              person->rig_);
    if (!motion.ok()) return motion.status();
    person->motion_ = *std::move(motion);
    return person;
}

std::int64_t Person::frames_per_loop() const {
    const double period_s = motion_->period_s();
    if (period_s <= 0) return 0;
    const double start_s = std::fmod(options_.motion_start_s, period_s);
    return static_cast<std::int64_t>(std::floor((period_s - start_s) / options_.motion_speed * fps_ + 1e-9));
}

bool Person::is_present(std::int64_t frame) const {
    const double time_s = static_cast<double>(frame) / fps_;
    if (options_.return_s >= 0 && time_s >= options_.return_s) return true;
    return time_s >= options_.enter_s && (options_.leave_s < 0 || time_s < options_.leave_s);
}

Pose Person::pose(std::int64_t frame) const {
    const std::int64_t loop = frames_per_loop();
    const double period_s = motion_->period_s();
    const double start_s =
        period_s > 0 ? std::fmod(options_.motion_start_s, period_s) : options_.motion_start_s;
    Pose pose = motion_->pose(start_s + static_cast<double>(loop > 0 ? frame % loop : frame) *
                                            options_.motion_speed / fps_);
    if (options_.motion_yaw_deg != 0) {
        const Mat3 turn = rotation_z(radians(options_.motion_yaw_deg));
        pose.root_in_world = turn * pose.root_in_world;
        pose[kPelvis] = turn * pose[kPelvis];
    }
    pose.root_in_world += options_.motion_shift;
    return pose;
}

void PeopleMesh::set(const std::vector<std::unique_ptr<Person>>& people, std::int64_t frame, bool casters) {
    std::vector<std::size_t> present;
    for (std::size_t n = 0; n < people.size(); ++n)
        if (people[n]->is_present(frame)) present.push_back(n);
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    if (!built_ || present != present_) {
        built_ = true;
        present_ = std::move(present);
        mesh_ = {};
        labels_.clear();
        for (const std::size_t n : present_) {
            const BodyMesh& mesh = casters ? people[n]->caster() : people[n]->mesh();
            const auto first = static_cast<std::uint32_t>(mesh_.surface.vertices.size());
            append(mesh_.surface.vertices, mesh.surface.vertices);
            for (const auto& t : mesh.surface.triangles)
                mesh_.surface.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
            append(mesh_.openness, mesh.openness);
            append(mesh_.texels, mesh.texels);
            labels_.resize(mesh_.surface.triangles.size(), static_cast<std::uint8_t>(n + 1));
        }
    }
    skinned_.vertices.clear();
    skinned_.normals.clear();
    for (const std::size_t n : present_) {
        if (casters)
            people[n]->skin_caster(frame, one_);
        else
            people[n]->skin_mesh(frame, one_);
        append(skinned_.vertices, one_.vertices);
        append(skinned_.normals, one_.normals);
    }
}

}  // namespace kinevox::studio
