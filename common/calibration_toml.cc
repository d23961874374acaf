// The Pose2Sim/aniposelib form: one table a camera with size, matrix, distortions, rotation (Rodrigues) and
// translation, the last two taking world points (metres) to camera points.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/toml_reader.h"

namespace kinevox {
namespace {

constexpr double kMaxFocalPx = 1e6;
constexpr double kMaxDistortion = 1e4;
constexpr double kMaxDistanceM = 1000;
constexpr double kMaxRotationRad = 2 * 3.141592653589793 + 1e-6;

void read_size(const TomlTable& table, Camera& camera) {
    const std::vector<double> size = table.numbers("size", 2, 2, {1, kMaxImagePx});
    if (size[0] != std::floor(size[0]) || size[1] != std::floor(size[1]))
        table.fail("size", "is not whole; write [width, height] in pixels");
    camera.width = static_cast<int>(size[0]);
    camera.height = static_cast<int>(size[1]);
}

void read_matrix(const TomlTable& table, Camera& camera) {
    const std::vector<double> m = table.matrix("matrix", 3, 3);
    if (m[1] != 0 || m[3] != 0 || m[6] != 0 || m[7] != 0 || m[8] != 1)
        table.fail("matrix",
                   "is not a pinhole matrix without skew; write [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
    if (!(m[0] > 0 && m[0] <= kMaxFocalPx && m[4] > 0 && m[4] <= kMaxFocalPx))
        table.fail("matrix",
                   fmt::format("has the focal lengths {} and {} px, expected above 0 and at most {}; "
                               "correct them",
                               m[0], m[4], kMaxFocalPx));
    if (std::abs(m[2]) > kMaxFocalPx || std::abs(m[5]) > kMaxFocalPx)
        table.fail("matrix",
                   fmt::format("has the principal point ({}, {}) px, far outside the image; correct it", m[2],
                               m[5]));
    camera.fx = m[0], camera.fy = m[4], camera.cx = m[2], camera.cy = m[5];
}

void read_pose(const TomlTable& table, Camera& camera) {
    const std::vector<double> r = table.numbers("rotation", 3, 3);
    const Vec3 rotation{r[0], r[1], r[2]};
    if (!(norm(rotation) <= kMaxRotationRad))
        table.fail("rotation",
                   fmt::format("is {:.6g} long, expected a Rodrigues vector in radians, at most 2 pi long; "
                               "convert it",
                               norm(rotation)));
    const std::vector<double> t = table.numbers("translation", 3, 3);
    const Vec3 translation{t[0], t[1], t[2]};
    if (!(norm(translation) <= kMaxDistanceM))
        table.fail("translation",
                   fmt::format("is {:.6g} long, expected metres, at most {}; convert it from mm?",
                               norm(translation), kMaxDistanceM));
    camera.camera_from_world = {rotation_from_rodrigues(rotation), translation};
}

Camera read_camera(const TomlTable& table, const std::string& section, std::string& given_name) {
    Camera camera;
    camera.name = section;
    given_name = table.text_or("name", section);
    read_size(table, camera);
    read_matrix(table, camera);
    std::vector<double> d = table.numbers("distortions", 4, 5, {-kMaxDistortion, kMaxDistortion});
    d.resize(5, 0.0);
    camera.k1 = d[0], camera.k2 = d[1], camera.p1 = d[2], camera.p2 = d[3], camera.k3 = d[4];
    read_pose(table, camera);
    if (table.boolean_or("fisheye", false))
        table.fail("fisheye",
                   "is true, expected false: the fisheye model is not supported; calibrate the camera with "
                   "the pinhole model (k1 k2 p1 p2 k3)");
    return camera;
}

}  // namespace

absl::StatusOr<std::vector<Camera>> parse_calibration_toml(const std::string& text,
                                                           const std::string& name_for_errors) {
    absl::StatusOr<std::unique_ptr<TomlDocument>> document = TomlDocument::parse(text, name_for_errors);
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    std::vector<Camera> cameras;
    std::vector<std::string> given_names;
    for (const std::string& section : root.keys()) {
        if (section == "metadata") {  // aniposelib's notes about how the calibration was made
            root.ignore(section);
            continue;
        }
        const std::string problem = camera_name_problem(section);
        if (!problem.empty()) root.fail(section, fmt::format("as a camera's name {}", problem));
        std::string given_name;
        cameras.push_back(read_camera(root.table_or_empty(section), section, given_name));
        const auto same = std::find(given_names.begin(), given_names.end(), given_name);
        if (same != given_names.end())
            root.fail(section,
                      fmt::format("has the name \"{}\", which [{}] has already; give each camera its own",
                                  given_name, cameras[same - given_names.begin()].name));
        given_names.push_back(given_name);
    }
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    if (cameras.empty())
        return absl::InvalidArgumentError(
            fmt::format("{}: holds no camera; add a table [NAME] with size, matrix, distortions, rotation "
                        "and translation for each",
                        name_for_errors));
    return cameras;
}

absl::StatusOr<std::vector<Camera>> read_calibration(const std::filesystem::path& file) {
    const std::string name = file.filename().string();
    const auto ends_with = [&](std::string_view ending) { return name.ends_with(ending); };
    const bool toml = ends_with(".toml");
    const bool qualisys = ends_with(".qca.txt") || ends_with(".qca") || ends_with(".xml");
    const bool opencv = ends_with(".yml") || ends_with(".yaml");
    if (!toml && !qualisys && !opencv)
        return absl::InvalidArgumentError(fmt::format(
            "{}: not a calibration by its ending; give a .toml (Pose2Sim, aniposelib), .qca.txt (Qualisys) "
            "or .yml (OpenCV, Kalibr)",
            file.string()));
    const absl::StatusOr<std::string> text = read_file(file);
    if (!text.ok()) return text.status();
    if (toml) return parse_calibration_toml(*text, file.string());
    if (qualisys) return parse_calibration_qualisys(*text, file.string());
    return text->find("camera_model") != std::string::npos ? parse_calibration_kalibr(*text, file.string())
                                                           : parse_calibration_opencv(*text, file.string());
}

std::string calibration_toml(const std::vector<Camera>& cameras) {
    std::string out =
        "# Cameras in the layout of Pose2Sim and aniposelib: matrix in px, distortions k1 k2 p1 p2 k3 "
        "(OpenCV),\n"
        "# rotation (Rodrigues vector, radians) and translation (metres) take world points to camera "
        "points.\n";
    const auto n = [](double value) { return toml_number(value); };
    for (const Camera& c : cameras) {
        const Vec3 r = rodrigues_from_rotation(c.camera_from_world.rotation);
        const Vec3 t = c.camera_from_world.translation;
        const std::string name = toml_quoted(c.name);
        const bool bare = !c.name.empty() && c.name.find_first_not_of(
                                                 "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrs"
                                                 "tuvwxyz0123456789_-") == std::string::npos;
        out += fmt::format(
            "\n[{}]\nname = {}\nsize = [{}.0, {}.0]\nmatrix = [[{}, 0.0, {}], [0.0, {}, {}], [0.0, 0.0, "
            "1.0]]\n"
            "distortions = [{}, {}, {}, {}, {}]\nrotation = [{}, {}, {}]\ntranslation = [{}, {}, {}]\n"
            "fisheye = false\n",
            bare ? c.name : name, name, c.width, c.height, n(c.fx), n(c.cx), n(c.fy), n(c.cy), n(c.k1),
            n(c.k2), n(c.p1), n(c.p2), n(c.k3), n(r.x), n(r.y), n(r.z), n(t.x), n(t.y), n(t.z));
    }
    return out;
}

absl::Status write_calibration_toml(const std::vector<Camera>& cameras, const std::filesystem::path& file) {
    const std::string out = calibration_toml(cameras);
    // What cannot be read back must not be written.
    if (const auto read_back = parse_calibration_toml(out, file.string()); !read_back.ok())
        return absl::InvalidArgumentError(fmt::format("calibration not written, it would be invalid: {}",
                                                      std::string(read_back.status().message())));
    return write_file_atomically(file, out);
}

}  // namespace kinevox
