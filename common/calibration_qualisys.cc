#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>

#include "common/calibration_file.h"
#include "common/one_line.h"

namespace kinevox {
namespace {

constexpr double kSubpixels = 64;  // Qualisys counts in 1/64 px
constexpr double kMmPerMetre = 1000;

// Reads attributes of one element and keeps the first error.
class Attributes {
  public:
    Attributes(pugi::xml_node parent, const char* element, std::string where, std::string& error)
        : element_(parent.child(element)), where_(std::move(where)), error_(error) {
        if (!element_ && error_.empty()) error_ = fmt::format("{}: <{}> is missing; add it", where_, element);
    }

    double number(const char* name) {
        const pugi::xml_attribute attribute = element_.attribute(name);
        if (!attribute) return wrong(name, "is missing; add it");
        const std::string_view text = attribute.value();
        double value = 0;
        const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (code != std::errc{} || end != text.data() + text.size() || !std::isfinite(value))
            return wrong(name,
                         fmt::format("is \"{}\", expected a finite number; correct it", text.substr(0, 60)));
        return value;
    }

    double number_between(const char* name, double lowest, double highest) {
        const double value = number(name);
        if (value >= lowest && value <= highest) return value;
        return wrong(
            name, fmt::format("is {}, expected a number from {} to {}; correct it", value, lowest, highest));
    }

  private:
    double wrong(const char* name, const std::string& what) {
        if (error_.empty()) error_ = fmt::format("{}: <{}> {} {}", where_, element_.name(), name, what);
        return 0;
    }
    pugi::xml_node element_;
    std::string where_;
    std::string& error_;
};

// From the camera's axes as Qualisys has them to OpenCV's.
Rigid3 camera_from_world(const Mat3& qualisys_camera_from_world, Vec3 centre_in_world) {
    Mat3 opencv_from_qualisys;  // half a turn about x: y up becomes y down, z backward becomes z forward
    opencv_from_qualisys(1, 1) = opencv_from_qualisys(2, 2) = -1;
    const Mat3 rotation = opencv_from_qualisys * qualisys_camera_from_world;
    return {rotation, -(rotation * centre_in_world)};
}

bool is_proper_rotation(const Mat3& r) {
    const Mat3 should_be_identity = r * r.transposed();
    for (int i = 0; i < 9; ++i)
        if (!(std::abs(should_be_identity.m[i] - (i % 4 == 0)) < 1e-4)) return false;
    const double determinant =
        dot({r(0, 0), r(0, 1), r(0, 2)}, cross({r(1, 0), r(1, 1), r(1, 2)}, {r(2, 0), r(2, 1), r(2, 2)}));
    return determinant > 0;
}

Camera read_camera(pugi::xml_node element, const std::string& where, std::string& error) {
    Camera camera;
    camera.name = element.attribute("serial").value();
    if (const std::string problem = camera_name_problem(camera.name); !problem.empty() && error.empty())
        error = fmt::format("{}: <camera> serial {}", where, problem);

    Attributes fov(element, "fov_video", where, error);
    camera.width =
        static_cast<int>(fov.number_between("right", 0, 32767) - fov.number_between("left", 0, 32767)) + 1;
    camera.height =
        static_cast<int>(fov.number_between("bottom", 0, 32767) - fov.number_between("top", 0, 32767)) + 1;
    if ((camera.width < 1 || camera.height < 1) && error.empty())
        error = fmt::format("{}: <fov_video> is {} x {} px, expected at least 1 x 1; correct it", where,
                            camera.width, camera.height);

    Attributes intrinsic(element, "intrinsic", where, error);
    camera.fx = intrinsic.number_between("focalLengthU", 1e-3, 64e6) / kSubpixels;
    camera.fy = intrinsic.number_between("focalLengthV", 1e-3, 64e6) / kSubpixels;
    camera.cx = intrinsic.number_between("centerPointU", -64e6, 64e6) / kSubpixels;
    camera.cy = intrinsic.number_between("centerPointV", -64e6, 64e6) / kSubpixels;
    camera.k1 = intrinsic.number_between("radialDistortion1", -1e4, 1e4);
    camera.k2 = intrinsic.number_between("radialDistortion2", -1e4, 1e4);
    camera.k3 = intrinsic.number_between("radialDistortion3", -1e4, 1e4);
    camera.p1 = intrinsic.number_between("tangentalDistortion1", -1e4, 1e4);
    camera.p2 = intrinsic.number_between("tangentalDistortion2", -1e4, 1e4);

    Attributes transform(element, "transform", where, error);
    Mat3 qualisys_camera_from_world;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) {
            const std::string name = fmt::format("r{}{}", row + 1, column + 1);
            qualisys_camera_from_world(row, column) = transform.number(name.c_str());
        }
    const Vec3 centre_mm{transform.number_between("x", -1e6, 1e6), transform.number_between("y", -1e6, 1e6),
                         transform.number_between("z", -1e6, 1e6)};
    if (!is_proper_rotation(qualisys_camera_from_world) && error.empty())
        error =
            fmt::format("{}: <transform> r11 to r33 are not a rotation; export the calibration again", where);
    camera.camera_from_world = camera_from_world(qualisys_camera_from_world, centre_mm / kMmPerMetre);
    return camera;
}

int line_of(const std::string& text, std::ptrdiff_t offset) {
    const std::size_t end =
        std::min<std::size_t>(offset < 0 ? 0 : static_cast<std::size_t>(offset), text.size());
    return 1 + static_cast<int>(std::count(text.begin(), text.begin() + end, '\n'));
}

}  // namespace

absl::StatusOr<std::vector<Camera>> parse_calibration_qualisys(const std::string& text,
                                                               const std::string& name_for_errors) {
    pugi::xml_document document;
    const pugi::xml_parse_result parsed = document.load_buffer(text.data(), text.size());
    if (!parsed)
        return absl::InvalidArgumentError(
            fmt::format("{}:{}: is not valid XML: {}; export the calibration again", name_for_errors,
                        line_of(text, parsed.offset), parsed.description()));
    std::vector<Camera> cameras;
    std::string error;
    for (pugi::xml_node element : document.child("calibration").child("cameras").children("camera")) {
        if (std::string_view(element.attribute("active").as_string("1")) == "0") continue;
        const std::string where =
            fmt::format("{}:{}", name_for_errors, line_of(text, element.offset_debug()));
        Camera camera = read_camera(element, where, error);
        const auto same_name = [&](const Camera& other) { return other.name == camera.name; };
        if (std::any_of(cameras.begin(), cameras.end(), same_name) && error.empty())
            error = fmt::format(
                "{}: <camera> serial is \"{}\", which an earlier camera has already; give each its own",
                where, camera.name);
        if (!error.empty()) return absl::InvalidArgumentError(one_line(error));
        cameras.push_back(std::move(camera));
    }
    if (cameras.empty())
        return absl::InvalidArgumentError(fmt::format(
            "{}: holds no active <camera> in <calibration><cameras>; is it a Qualisys calibration?",
            name_for_errors));
    return cameras;
}

}  // namespace kinevox
