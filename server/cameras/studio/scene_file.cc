#include "server/cameras/studio/scene_file.h"

#include <absl/status/status.h>
#include <fmt/format.h>

#include <array>
#include <utility>
#include <vector>

#include "common/files.h"
#include "common/toml_reader.h"
#include "server/cameras/studio/person.h"

namespace kinevox::studio {
namespace {

constexpr std::array<std::pair<std::string_view, ShirtPattern>, 5> kPatterns{
    {{"stripes", ShirtPattern::kStripes},
     {"dots", ShirtPattern::kDots},
     {"checks", ShirtPattern::kChecks},
     {"plain", ShirtPattern::kPlain},
     {"two_tone", ShirtPattern::kTwoTone}}};
constexpr std::array<std::pair<std::string_view, TextureKind>, 4> kFloors{
    {{"wood", TextureKind::kWoodFloor},
     {"concrete", TextureKind::kConcrete},
     {"track", TextureKind::kTrack},
     {"mat", TextureKind::kMat}}};
constexpr std::array<std::pair<std::string_view, TextureKind>, 3> kWalls{
    {{"paint", TextureKind::kPaint}, {"brick", TextureKind::kBrick}, {"panelling", TextureKind::kPanelling}}};

template <typename Value, std::size_t N>
void choose(const TomlTable& table, std::string_view key,
            const std::array<std::pair<std::string_view, Value>, N>& from, std::optional<Value>& out) {
    if (!table.has(key)) return;
    std::vector<std::string_view> names;
    for (const auto& [name, value] : from) names.push_back(name);
    const std::string chosen = table.choice_or(key, std::string(names.front()), names);
    for (const auto& [name, value] : from)
        if (name == chosen) out = value;
}
void read(const TomlTable& table, std::string_view key, std::optional<double>& out, TomlRange range) {
    if (table.has(key)) out = table.number(key, range);
}
void read(const TomlTable& table, std::string_view key, std::optional<bool>& out) {
    if (table.has(key)) out = table.boolean_or(key, false);
}
void read(const TomlTable& table, std::string_view key, std::optional<Albedo>& out, double max = 1) {
    if (!table.has(key)) return;
    const std::vector<double> rgb = table.numbers(key, 3, 3, {0, max});
    if (rgb.size() == 3)
        out = Albedo{static_cast<float>(rgb[0]), static_cast<float>(rgb[1]), static_cast<float>(rgb[2])};
}
bool read(const TomlTable& table, std::string_view key, Vec3& out) {
    if (!table.has(key)) return false;
    const std::vector<double> xyz = table.numbers(key, 3, 3, {-100, 100});
    if (xyz.size() == 3) out = {xyz[0], xyz[1], xyz[2]};
    return xyz.size() == 3;
}

void read_motion(const TomlTable& table, PersonOptions& out) {
    out.motion = table.choice_or("name", out.motion, kMotionNames);
    out.motion_speed = table.number_or("speed", out.motion_speed, {0.2, 3});
    out.motion_start_s = table.number_or("start_s", out.motion_start_s, {0, 100});
    out.motion_yaw_deg = table.number_or("yaw_deg", out.motion_yaw_deg, {-360, 360});
    if (table.has("shift_m")) {
        const std::vector<double> xy = table.numbers("shift_m", 2, 2, {-3, 3});
        if (xy.size() == 2) out.motion_shift = {xy[0], xy[1], 0};
    }
    out.enter_s = table.number_or("enter_s", out.enter_s, {-1, 1e5});
    out.leave_s = table.number_or("leave_s", out.leave_s, {-1, 1e5});
    out.return_s = table.number_or("return_s", out.return_s, {-1, 1e5});
}

void read_subject(const TomlTable& table, PersonOptions& out) {
    SubjectOptions& s = out.subject;
    out.stature_m = table.number_or("stature_m", out.stature_m, {0, 2.2});
    read(table, "girth", s.girth, {0.75, 1.4});
    read(table, "femininity", s.femininity, {0, 1});
    for (const auto& [key, scale] :
         std::initializer_list<std::pair<std::string_view, double*>>{{"leg_scale", &s.leg_scale},
                                                                     {"arm_scale", &s.arm_scale},
                                                                     {"shoulder_scale", &s.shoulder_scale},
                                                                     {"hip_scale", &s.hip_scale}})
        *scale = table.number_or(key, *scale, {0.85, 1.15});
    s.belly = table.number_or("belly", s.belly, {0, 1});
    s.cloth_grain = table.number_or("cloth_grain", s.cloth_grain, {0, 2});
    s.looseness = table.number_or("looseness", s.looseness, {0, 3});
    read(table, "long_hair", s.long_hair);
    read(table, "shorts", s.shorts);
    read(table, "long_sleeves", s.long_sleeves);
    choose(table, "shirt_pattern", kPatterns, s.pattern);
    for (const auto& [key, colour] :
         std::initializer_list<std::pair<std::string_view, std::optional<Albedo>*>>{
             {"skin", &s.skin},
             {"hair", &s.hair},
             {"shirt", &s.shirt_a},
             {"shirt_second", &s.shirt_b},
             {"trousers", &s.trousers},
             {"shoes", &s.shoes}})
        read(table, key, *colour);
}

void read_people(const TomlTable& root, StudioOptions& out) {
    PersonOptions first = first_person(out);
    read_motion(root.table_or_empty("motion"), first);
    read_subject(root.table_or_empty("subject"), first);
    out.motion = first.motion;
    out.stature_m = first.stature_m;
    out.motion_speed = first.motion_speed;
    out.motion_start_s = first.motion_start_s;
    out.motion_yaw_deg = first.motion_yaw_deg;
    out.motion_shift = first.motion_shift;
    out.subject = first.subject;
    out.enter_s = first.enter_s;
    out.leave_s = first.leave_s;
    out.return_s = first.return_s;
    for (const TomlTable& table : root.tables("person")) {
        PersonOptions& person = out.others.emplace_back();
        person.seed = static_cast<std::uint32_t>(table.integer_or(
            "seed", out.seed + static_cast<std::int64_t>(out.others.size()), 0, 0xffffffffLL));
        read_motion(table.table_or_empty("motion"), person);
        read_subject(table.table_or_empty("subject"), person);
    }
}

void read_room(const TomlTable& table, StudioOptions& out) {
    static constexpr std::array<std::string_view, 3> kStages{"auto", "room", "lane"};
    out.stage = table.choice_or("stage", out.stage, kStages);
    choose(table, "floor", kFloors, out.room.floor);
    choose(table, "walls", kWalls, out.room.walls);
    read(table, "floor_colour", out.room.floor_colour);
    read(table, "wall_colour", out.room.wall_colour);
    out.room.floor_grain = table.number_or("floor_grain", 1, {0, 2});
    out.room.wall_grain = table.number_or("wall_grain", 1, {0, 2});
    out.room.furniture = table.boolean_or("furniture", true);
    out.room.decals = table.boolean_or("decals", true);
}

void read_light(const TomlTable& table, StudioOptions& out) {
    LightOptions& light = out.light;
    light.key_fraction = table.number_or("key_fraction", light.key_fraction, {0, 0.95});
    light.panels_fraction = table.number_or("panels_fraction", light.panels_fraction, {0, 0.95});
    if (Vec3 at; read(table, "key_position_m", at)) light.key_position = at;
    read(table, "key_half_m", light.key_half_m, {0.02, 1});
    light.exposure = table.number_or("exposure", light.exposure, {0.2, 2});
    read(table, "tint", light.tint, 1.5);
    light.area_shadows = table.boolean_or("area_shadows", true);
    out.flicker = table.number_or("flicker", out.flicker, {0, 0.3});
}

void read_cameras(const TomlTable& root, StudioOptions& out) {
    const TomlTable sensor = root.table_or_empty("sensor");
    out.noise_grey = sensor.number_or("noise_grey", out.noise_grey, {0, 50});
    out.shot_noise_grey = sensor.number_or("shot_noise_grey", out.shot_noise_grey, {0, 20});
    for (const TomlTable& table : root.tables("camera")) {
        PlacedCamera camera;
        if (!read(table, "position_m", camera.position_in_world))
            table.fail("position_m", "is missing, expected 3 numbers; give the camera's x, y, z in metres");
        if (table.has("size_px")) {
            const std::vector<double> size = table.numbers("size_px", 2, 2, {64, 4096});
            if (size.size() == 2)
                camera.width = static_cast<int>(size[0]), camera.height = static_cast<int>(size[1]);
        }
        camera.zoom = table.number_or("zoom", 1, {0.3, 3});
        camera.roll_deg = table.number_or("roll_deg", 0, {-180, 180});
        read(table, "aim_offset_m", camera.aim_offset);
        if (table.has("distortion")) {
            const std::vector<double> k = table.numbers("distortion", 5, 5, {-0.5, 0.5});
            if (k.size() == 5)
                camera.k1 = k[0], camera.k2 = k[1], camera.p1 = k[2], camera.p2 = k[3], camera.k3 = k[4];
        }
        out.placed_cameras.push_back(camera);
    }
}

}  // namespace

absl::StatusOr<Scene> parse_scene(std::string_view text, std::string_view name_for_errors) {
    auto document = TomlDocument::parse(text, name_for_errors);
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    Scene scene;
    StudioOptions& studio = scene.studio;
    studio.seed = static_cast<std::uint32_t>(root.integer_or("seed", 1, 0, 0xffffffffLL));
    studio.fps = root.number_or("fps", studio.fps, {1, 1000});
    scene.writer.frames = root.integer_or("frames", scene.writer.frames, 1, 1000000);
    scene.writer.background_frames =
        static_cast<int>(root.integer_or("background_frames", scene.writer.background_frames, 1, 10000));
    scene.writer.crf = static_cast<int>(root.integer_or("crf", scene.writer.crf, 0, 51));
    read_people(root, studio);
    read_room(root.table_or_empty("room"), studio);
    read_light(root.table_or_empty("light"), studio);
    read_cameras(root, studio);
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    if (const std::string wrong = studio.check(); !wrong.empty())
        return absl::InvalidArgumentError(fmt::format("{}: {}", name_for_errors, wrong));
    return scene;
}

absl::StatusOr<Scene> read_scene(const std::filesystem::path& file) {
    absl::StatusOr<std::string> text = read_file(file);
    if (!text.ok()) return text.status();
    return parse_scene(*text, file.string());
}

}  // namespace kinevox::studio
