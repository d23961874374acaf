#include "server/cameras/studio/studio.h"

#include <absl/status/status.h>
#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/cameras/studio/area_shadow.h"
#include "server/cameras/studio/body_raster.h"
#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/motion.h"
#include "server/cameras/studio/person.h"
#include "server/cameras/studio/room.h"
#include "server/cameras/studio/shadow.h"
#include "server/cameras/studio/virtual_camera.h"

namespace kinevox::studio {
namespace {

// Light to the power 1 / 2.2 by table; light 0 .. 4.
class ShownLight {
  public:
    ShownLight() {
        for (int i = 0; i <= kSteps; ++i)
            table_[i] = std::pow(4.0f * static_cast<float>(i) / kSteps, 1 / 2.2f);
    }
    float operator()(float light) const {
        const float x = std::clamp(light, 0.0f, 3.99f) * (kSteps / 4.0f);
        const int i = static_cast<int>(x);
        return table_[i] + (x - i) * (table_[i + 1] - table_[i]);
    }

  private:
    static constexpr int kSteps = 2048;
    std::array<float, kSteps + 1> table_;
};

class RenderedStudio final : public Studio {
  public:
    RenderedStudio(const StudioOptions& options, Stage stage)
        : options_(options),
          cameras_(!options.custom_cameras.empty()   ? options.custom_cameras
                   : !options.placed_cameras.empty() ? cameras_as_placed(options, stage == Stage::kLane)
                                                     : ring_of_cameras(options, stage == Stage::kLane)),
          room_(stage, options.seed, options.room, options.light),
          sensor_(options.noise_grey, options.flicker, options.fps, options.seed, options.shot_noise_grey),
          rasters_(cameras_.size()),
          rows_(cameras_.size()) {
        for (const Camera& camera : cameras_) views_.push_back(room_.draw(camera));
        if (options_.light.area_shadows) area_shadow_.emplace(room_);
        if (options_.staging.bump) {
            bumped_ = camera_after_bump(*options_.staging.bump, cameras_);
            bumped_view_ = room_.draw(bumped_);
        }
    }
    absl::Status start() {
        std::vector<PersonOptions> people{first_person(options_)};
        people.insert(people.end(), options_.others.begin(), options_.others.end());
        for (const PersonOptions& each : people) {
            auto person = Person::create(each, options_.fps, options_.stage);
            if (!person.ok()) return person.status();
            people_.push_back(*std::move(person));
        }
        return absl::OkStatus();
    }

    const StudioOptions& options() const override { return options_; }
    const std::vector<Camera>& cameras() const override { return cameras_; }
    std::int64_t frames_per_loop() const override { return people_.front()->frames_per_loop(); }
    std::string description() const override;
    std::vector<Image> draw(std::int64_t frame, bool parallel) override;
    Image draw_empty(std::size_t camera, std::int64_t frame) const override;
    std::size_t person_count() const override { return people_.size(); }
    bool is_present(std::size_t person, std::int64_t frame) const override {
        return people_[person]->is_present(frame);
    }
    SubjectTruth truth(std::int64_t frame, std::size_t person) const override {
        return {people_[person]->joints(frame)};
    }
    const Camera& camera_at(std::size_t camera, std::int64_t frame) const override {
        return is_bumped(camera, frame) ? bumped_ : cameras_[camera];
    }
    Rigid3 world_from_target(std::int64_t frame) const override {
        return options_.staging.has_target()
                   ? studio::world_from_target(options_.staging, cameras_, frame, options_.fps)
                   : Rigid3{};
    }
    std::vector<std::vector<std::uint8_t>> labels(std::int64_t frame) override;
    Surface surface(std::int64_t frame) override;

  private:
    bool is_bumped(std::size_t camera, std::int64_t frame) const {
        const std::optional<CameraBump>& bump = options_.staging.bump;
        return bump && camera == bump->camera && static_cast<double>(frame) >= bump->time_s * options_.fps;
    }
    void light_body();
    void draw_camera(std::size_t camera, std::int64_t frame, std::uint8_t* out);
    CellBounds shadow_box(const Camera& camera) const;
    std::uint32_t row_key(std::size_t camera, std::int64_t frame, int row, std::uint32_t what) const {
        return hash_u32(hash_u32(options_.seed, static_cast<std::uint32_t>(camera), what),
                        static_cast<std::uint32_t>(frame), static_cast<std::uint32_t>(row));
    }

    StudioOptions options_;
    std::vector<Camera> cameras_;
    std::vector<std::unique_ptr<Person>> people_;
    Room room_;
    Sensor sensor_;
    ShownLight shown_;
    std::vector<RoomView> views_;
    Camera bumped_;  // the camera after the bump; unused without one
    RoomView bumped_view_;
    // Of the frame being drawn.
    PeopleMesh body_, caster_;
    std::vector<Vec3f> vertex_light_, shown_light_;  // per vertex, per triangle
    FloorShadow floor_shadow_;
    std::optional<AreaShadow> area_shadow_;  // instead of floor_shadow_
    BodyShadow body_shadow_;
    std::vector<BodyRaster> rasters_;
    std::vector<std::vector<std::uint16_t>> rows_;
};

std::string RenderedStudio::description() const {
    if (!options_.staging.person)
        return fmt::format("{} at {} fps, no person: {} cameras of {} x {} px",
                           options_.staging.board  ? "a board"
                           : options_.staging.wand ? "a wand"
                                                   : "the empty room",
                           options_.fps, cameras_.size(), cameras_.front().width, cameras_.front().height);
    const std::string who = people_.size() > 1
                                ? fmt::format("{} people", people_.size())
                                : fmt::format("a person of {:.2f} m", people_.front()->subject().stature_m);
    return fmt::format("{} at {} fps: {}, {} cameras of {} x {} px", options_.motion, options_.fps, who,
                       cameras_.size(), cameras_.front().width, cameras_.front().height);
}

void RenderedStudio::light_body() {
    const Lighting& lights = room_.lighting();
    const SkinnedBody& skinned = body_.skinned();
    const BodyMesh& mesh = body_.mesh();
    vertex_light_.resize(skinned.vertices.size());
    for (std::size_t i = 0; i < vertex_light_.size(); ++i) {
        const Vec3f p = skinned.vertices[i], n = normalized(skinned.normals[i]);
        Vec3f light = Lighting::direct(lights.key, p, n);
        if (light.y > 0) light = body_shadow_.lit(p + 0.02f * n) * light;
        Vec3f fill = lights.ambient(n);
        for (const Lamp& lamp : lights.panels) fill += Lighting::direct(lamp, p, n);
        light += mesh.openness[i] * fill;
        vertex_light_[i] = {shown_(light.x), shown_(light.y), shown_(light.z)};
    }
    const auto& triangles = mesh.surface.triangles;
    shown_light_.resize(triangles.size());
    for (std::size_t t = 0; t < triangles.size(); ++t)
        shown_light_[t] = (1 / 3.0f) * (vertex_light_[triangles[t][0]] + vertex_light_[triangles[t][1]] +
                                        vertex_light_[triangles[t][2]]);
}

std::vector<Image> RenderedStudio::draw(std::int64_t frame, bool parallel) {
    const Staging& staging = options_.staging;
    if (staging.person) {
        body_.set(people_, frame, false);
        caster_.set(people_, frame, true);
        const TriangleMesh& surface = caster_.mesh().surface;
        const std::vector<Vec3f>& vertices = caster_.skinned().vertices;
        if (area_shadow_)
            area_shadow_->cast(surface, vertices);
        else
            floor_shadow_.cast(surface, vertices, room_.lighting());
        body_shadow_.cast(surface, vertices, room_.lighting().key.position);
        light_body();
    }

    std::vector<Image> images(cameras_.size());
    const auto one = [&](std::size_t i) {
        const Camera& camera = cameras_[i];
        std::shared_ptr<std::uint8_t[]> data(
            new std::uint8_t[static_cast<std::size_t>(camera.width) * camera.height * 3]);
        draw_camera(i, frame, data.get());
        images[i] = {camera.width, camera.height, 3, std::move(data)};
        if (staging.has_target())
            images[i] = draw_target(staging, images[i], camera_at(i, frame), world_from_target(frame),
                                    options_.noise_grey, row_key(i, frame, 0, 3));
    };
    if (parallel) {
        tbb::parallel_for(std::size_t{0}, cameras_.size(), one);
    } else {
        for (std::size_t i = 0; i < cameras_.size(); ++i) one(i);
    }
    return images;
}

// Pixels that may show the shadow on the floor.
CellBounds RenderedStudio::shadow_box(const Camera& camera) const {
    if (floor_shadow_.empty()) return {};
    float x[2], y[2];
    floor_shadow_.extent(x[0], y[0], x[1], y[1]);
    const Lens lens(camera);
    float u0 = 1e9f, v0 = 1e9f, u1 = -1e9f, v1 = -1e9f;
    for (int i = 0; i < 16; ++i) {  // along the rectangle's edge, which the lens distorts
        const float s = static_cast<float>(i % 4) / 4;
        const float ex = i / 4 == 0   ? s
                         : i / 4 == 1 ? 1
                         : i / 4 == 2 ? 1 - s
                                      : 0,
                    ey = i / 4 == 0   ? 0
                         : i / 4 == 1 ? s
                         : i / 4 == 2 ? 1
                                      : 1 - s;
        const Vec3f p = lens.project({x[0] + ex * (x[1] - x[0]), y[0] + ey * (y[1] - y[0]), 0});
        if (p.z < 0.2f) return {0, 0, camera.width, camera.height};
        u0 = std::min(u0, p.x);
        u1 = std::max(u1, p.x);
        v0 = std::min(v0, p.y);
        v1 = std::max(v1, p.y);
    }
    const auto inside = [](float v, int size) {
        return static_cast<int>(std::clamp(v, 0.0f, static_cast<float>(size)));
    };
    return {inside(u0 - 6, camera.width), inside(v0 - 6, camera.height), inside(u1 + 7, camera.width),
            inside(v1 + 7, camera.height)};
}

void RenderedStudio::draw_camera(std::size_t index, std::int64_t frame, std::uint8_t* out) {
    const Camera& camera = camera_at(index, frame);
    const RoomView& view = is_bumped(index, frame) ? bumped_view_ : views_[index];
    BodyRaster& raster = rasters_[index];
    CellBounds body, dark;
    if (options_.staging.person) {
        raster.draw(camera, body_.mesh(), body_.skinned(), shown_light_);
        body = raster.box();
        dark = area_shadow_ ? CellBounds{0, 0, camera.width, camera.height} : shadow_box(camera);
    }
    const double gain = sensor_.gain(static_cast<std::uint32_t>(index), frame);
    const int values = 3 * camera.width;
    std::vector<std::uint16_t>& row = rows_[index];
    row.resize(static_cast<std::size_t>(values));
    for (int y = 0; y < camera.height; ++y) {
        const std::uint16_t* light = &view.bgr[static_cast<std::size_t>(y) * values];
        const bool has_body = y >= body.y0 && y < body.y1, has_shadow = y >= dark.y0 && y < dark.y1;
        if (has_body || has_shadow) {
            std::copy(light, light + values, row.begin());
            light = row.data();
        }
        if (has_shadow) {
            const std::size_t first = static_cast<std::size_t>(y) * camera.width;
            if (area_shadow_) area_shadow_->darken(view, first, camera.width, row.data());
            for (int x = dark.x0; !area_shadow_ && x < dark.x1; ++x) {
                const std::size_t pixel = first + static_cast<std::size_t>(x);
                if (view.face[pixel] != 0) continue;
                const float factor = floor_shadow_.factor(view.at[2 * pixel], view.at[2 * pixel + 1]);
                if (factor >= 1.0f) continue;
                for (int c = 0; c < 3; ++c)
                    row[3 * x + c] = static_cast<std::uint16_t>(factor * row[3 * x + c]);
            }
        }
        if (has_body) raster.blend_row(y, row.data());
        sensor_.expose(light, values, gain, row_key(index, frame, y, 1),
                       out + static_cast<std::size_t>(y) * values);
    }
}

Image RenderedStudio::draw_empty(std::size_t index, std::int64_t frame) const {
    const Camera& camera = cameras_[index];
    const int values = 3 * camera.width;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[static_cast<std::size_t>(values) * camera.height]);
    // Before the first frame, so that noise and flicker are independent.
    const std::int64_t time_index = -1000 - frame;
    const double gain = sensor_.gain(static_cast<std::uint32_t>(index), time_index);
    for (int y = 0; y < camera.height; ++y)
        sensor_.expose(&views_[index].bgr[static_cast<std::size_t>(y) * values], values, gain,
                       row_key(index, frame, y, 2), data.get() + static_cast<std::size_t>(y) * values);
    return {camera.width, camera.height, 3, std::move(data)};
}

std::vector<std::vector<std::uint8_t>> RenderedStudio::labels(std::int64_t frame) {
    std::vector<std::vector<std::uint8_t>> out(cameras_.size());
    if (!options_.staging.person) {
        for (std::size_t i = 0; i < out.size(); ++i)
            out[i].assign(static_cast<std::size_t>(cameras_[i].width) * cameras_[i].height, 0);
        return out;
    }
    body_.set(people_, frame, false);
    tbb::parallel_for(std::size_t{0}, cameras_.size(), [&](std::size_t i) {
        rasters_[i].label(camera_at(i, frame), body_.mesh(), body_.skinned(), body_.labels(), out[i]);
    });
    return out;
}

Studio::Surface RenderedStudio::surface(std::int64_t frame) {
    SkinnedBody skinned;
    people_.front()->skin_mesh(frame, skinned);
    Surface out;
    for (const Vec3f& v : skinned.vertices) out.vertices.push_back(to_double(v));
    out.triangles = people_.front()->mesh().surface.triangles;
    return out;
}

}  // namespace

std::string PlacedCamera::check() const {
    if (width < 64 || width > 4096 || height < 64 || height > 4096)
        return fmt::format("size of a camera is {}x{}; each side must be 64 .. 4096 px", width, height);
    if (!(zoom >= 0.3 && zoom <= 3)) return fmt::format("zoom of a camera is {}; it must be 0.3 .. 3", zoom);
    for (const double k : {k1, k2, p1, p2, k3})
        if (!(std::abs(k) <= 0.5))
            return fmt::format("distortion of a camera is {}; it must be -0.5 .. 0.5", k);
    return {};
}

std::vector<std::vector<std::uint8_t>> Studio::masks(std::int64_t frame) {
    std::vector<std::vector<std::uint8_t>> out = labels(frame);
    for (std::vector<std::uint8_t>& image : out)
        for (std::uint8_t& pixel : image) pixel = pixel ? 255 : 0;
    return out;
}

namespace {

bool outside(double v, double low, double high) {
    return !(v >= low && v <= high);
}

}  // namespace

std::string PersonOptions::check() const {
    if (std::find(kMotionNames.begin(), kMotionNames.end(), motion) == kMotionNames.end())
        return fmt::format("motion '{}' is unknown; choose one of {}", motion, fmt::join(kMotionNames, ", "));
    if (stature_m != 0 && outside(stature_m, 1.2, 2.2))
        return fmt::format("stature is {} m; it must be 1.2 .. 2.2, or 0 for a random one", stature_m);
    if (outside(motion_speed, 0.2, 3))
        return fmt::format("the motion's speed is {}; it must be 0.2 .. 3", motion_speed);
    if (outside(motion_start_s, 0, 100))
        return fmt::format("the motion starts at {} s; it must be 0 .. 100", motion_start_s);
    if (motion_shift.z != 0) return "the motion is shifted vertically; it must stay on the floor";
    if (leave_s >= 0 && !(leave_s > enter_s))
        return fmt::format("a person leaves at {} s and enters at {} s; leave later", leave_s, enter_s);
    if (return_s >= 0 && !(leave_s >= 0 && return_s > leave_s))
        return fmt::format("a person returns at {} s without leaving before; set leave_s below it", return_s);
    return subject.check();
}

std::string StudioOptions::check() const {
    if (const std::string wrong = first_person(*this).check(); !wrong.empty()) return wrong;
    for (const PersonOptions& other : others)
        if (const std::string wrong = other.check(); !wrong.empty()) return wrong;
    if (others.size() > 15) return fmt::format("{} people; at most 16 are rendered", others.size() + 1);
    if (stage != "auto" && stage != "room" && stage != "lane")
        return fmt::format("stage '{}' is unknown; choose one of auto, room, lane", stage);
    if (motion == "sprint_start" && stage == "room")
        return "motion sprint_start needs stage lane; the room is too short";
    if (custom_cameras.empty() && placed_cameras.empty() && (cameras < 1 || cameras > 64))
        return fmt::format("cameras is {}; it must be 1 .. 64", cameras);
    if (width < 64 || width > 4096 || height < 64 || height > 4096)
        return fmt::format("size is {}x{}; each side must be 64 .. 4096 px", width, height);
    if (outside(fps, 1, 1000)) return fmt::format("fps is {}; it must be 1 .. 1000", fps);
    if (outside(noise_grey, 0, 50))
        return fmt::format("noise is {} grey levels; it must be 0 .. 50", noise_grey);
    if (outside(flicker, 0, 0.3)) return fmt::format("flicker is {}; it must be 0 .. 0.3", flicker);
    if (outside(distortion, -0.3, 0.3))
        return fmt::format("distortion is {}; it must be -0.3 .. 0.3", distortion);
    if (outside(shot_noise_grey, 0, 20))
        return fmt::format("shot noise is {} grey levels; it must be 0 .. 20", shot_noise_grey);
    for (const PlacedCamera& camera : placed_cameras)
        if (const std::string wrong = camera.check(); !wrong.empty()) return wrong;
    for (const std::string& wrong : {room.check(), light.check()})
        if (!wrong.empty()) return wrong;
    const std::size_t count = !custom_cameras.empty()   ? custom_cameras.size()
                              : !placed_cameras.empty() ? placed_cameras.size()
                                                        : static_cast<std::size_t>(cameras);
    return staging.check(count);
}

absl::StatusOr<std::unique_ptr<Studio>> Studio::create(const StudioOptions& options) {
    if (const std::string wrong = options.check(); !wrong.empty())
        return absl::InvalidArgumentError("studio: " + wrong);
    const bool lane =
        options.stage == "lane" || (options.stage == "auto" && natural_stage(options.motion) == Stage::kLane);
    auto studio = std::make_unique<RenderedStudio>(options, lane ? Stage::kLane : Stage::kRoom);
    if (absl::Status status = studio->start(); !status.ok()) return status;
    return studio;
}

}  // namespace kinevox::studio
