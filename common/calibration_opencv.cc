#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "common/calibration_file.h"
#include "common/one_line.h"
#include "common/toml_reader.h"

namespace kinevox {
namespace {

// One camera's map; keeps the first error.
class CameraMap {
  public:
    CameraMap(const YAML::Node& map, std::string file, std::string& error)
        : map_(map), file_(std::move(file)), error_(error) {}

    // The matrix's elements; `counts` are the allowed numbers of them.
    std::vector<double> matrix(const char* key, std::vector<std::size_t> counts, bool required) {
        const std::vector<double> zeros(counts.front(), 0.0);
        const YAML::Node matrix = map_[key];
        if (!matrix) {
            if (required) wrong(map_, key, "is missing; add it");
            return zeros;
        }
        const YAML::Node data = matrix.IsMap() ? matrix["data"] : matrix;
        const std::string expected = fmt::format("expected an opencv-matrix of {} finite numbers; correct it",
                                                 fmt::join(counts, " or "));
        if (!data || !data.IsSequence() ||
            std::find(counts.begin(), counts.end(), data.size()) == counts.end()) {
            wrong(matrix, key, "has another shape, " + expected);
            return zeros;
        }
        std::vector<double> values;
        for (const YAML::Node& element : data) {
            double value = 0;
            if (!element.IsScalar() || !YAML::convert<double>::decode(element, value) ||
                !std::isfinite(value)) {
                wrong(element, key,
                      fmt::format("holds \"{}\", {}",
                                  element.IsScalar() ? element.Scalar().substr(0, 60) : "", expected));
                return zeros;
            }
            values.push_back(value);
        }
        return values;
    }

    int pixels(const char* key) {
        const YAML::Node node = map_[key];
        double value = 0;
        if (!node || !node.IsScalar() || !YAML::convert<double>::decode(node, value) ||
            value != std::floor(value) || value < 1 || value > kMaxImagePx) {
            wrong(node ? node : map_, key,
                  fmt::format("is missing or not an integer from 1 to {}; correct it", kMaxImagePx));
            return 1;
        }
        return static_cast<int>(value);
    }

    void wrong(const YAML::Node& where, const char* key, const std::string& what) {
        if (error_.empty())
            error_ = fmt::format("{}:{}: key '{}' {}", file_, where.Mark().line + 1, key, what);
    }

    const YAML::Node& map() const { return map_; }

  private:
    YAML::Node map_;
    std::string file_;
    std::string& error_;
};

Mat3 read_rotation(CameraMap& reader) {
    const std::vector<double> r = reader.matrix("rotation", {3, 9}, false);
    if (r.size() == 3) {
        if (norm({r[0], r[1], r[2]}) > 6.2832)
            reader.wrong(reader.map()["rotation"], "rotation",
                         "is longer than 2 pi, expected radians; convert it");
        else
            return rotation_from_rodrigues({r[0], r[1], r[2]});
        return {};
    }
    Mat3 rotation;
    std::copy(r.begin(), r.end(), rotation.m.begin());
    const Mat3 should_be_identity = rotation * rotation.transposed();
    const double determinant = dot({r[0], r[1], r[2]}, cross({r[3], r[4], r[5]}, {r[6], r[7], r[8]}));
    bool proper = determinant > 0;
    for (int i = 0; i < 9; ++i) proper = proper && std::abs(should_be_identity.m[i] - (i % 4 == 0)) < 1e-4;
    if (!proper) reader.wrong(reader.map()["rotation"], "rotation", "is not a rotation; correct it");
    return rotation;
}

Camera read_camera(const YAML::Node& map, const std::string& name, const std::string& file,
                   std::string& error) {
    CameraMap reader(map, file, error);
    Camera camera;
    camera.name = name;
    if (const std::string problem = camera_name_problem(name); !problem.empty())
        reader.wrong(map, name.c_str(), "as a camera's name " + problem);
    camera.width = reader.pixels("image_width");
    camera.height = reader.pixels("image_height");
    const std::vector<double> m = reader.matrix("camera_matrix", {9}, true);
    if (!(m[0] > 0 && m[0] <= 1e6 && m[4] > 0 && m[4] <= 1e6) || m[1] != 0 || m[3] != 0 || m[6] != 0 ||
        m[7] != 0 || m[8] != 1 || std::abs(m[2]) > 1e6 || std::abs(m[5]) > 1e6)
        reader.wrong(map["camera_matrix"], "camera_matrix",
                     "is not a pinhole matrix without skew; write data: [fx, 0, cx, 0, fy, cy, 0, 0, 1]");
    camera.fx = m[0], camera.fy = m[4], camera.cx = m[2], camera.cy = m[5];
    std::vector<double> d = reader.matrix("distortion_coefficients", {5, 4}, true);
    d.resize(5, 0.0);
    camera.k1 = d[0], camera.k2 = d[1], camera.p1 = d[2], camera.p2 = d[3], camera.k3 = d[4];
    for (const double value : d)
        if (std::abs(value) > 1e4)
            reader.wrong(map["distortion_coefficients"], "distortion_coefficients",
                         "is absurdly large; correct it");
    camera.camera_from_world.rotation = read_rotation(reader);
    const std::vector<double> t = reader.matrix("translation", {3}, false);
    camera.camera_from_world.translation = {t[0], t[1], t[2]};
    if (!(norm(camera.camera_from_world.translation) <= 1000))
        reader.wrong(map["translation"], "translation", "is longer than 1000 m; convert it from mm?");
    return camera;
}

}  // namespace

absl::StatusOr<std::vector<Camera>> parse_calibration_opencv(const std::string& text,
                                                             const std::string& name_for_errors) {
    // "%YAML:1.0" is OpenCV's own spelling of the directive, which YAML parsers reject.
    std::string yaml = text;
    if (yaml.starts_with("%YAML:")) yaml[5] = ' ';
    std::vector<Camera> cameras;
    std::string error;
    try {
        const YAML::Node root = YAML::Load(yaml);
        if (!root.IsMap())
            return absl::InvalidArgumentError(fmt::format(
                "{}: holds no camera; see common/calibration_file.h for the layout", name_for_errors));
        if (root["camera_matrix"]) {
            const std::string stem = std::filesystem::path(name_for_errors).stem().string();
            cameras.push_back(read_camera(root, stem, name_for_errors, error));
        } else {
            for (const auto& entry : root) {
                if (!entry.second.IsMap()) continue;  // OpenCV's notes: calibration_time, board_width, ...
                cameras.push_back(
                    read_camera(entry.second, entry.first.as<std::string>(), name_for_errors, error));
                const auto same_name = [&](const Camera& other) { return other.name == cameras.back().name; };
                if (std::any_of(cameras.begin(), cameras.end() - 1, same_name) && error.empty())
                    error = fmt::format("{}:{}: camera '{}' is there twice; give each camera its own name",
                                        name_for_errors, entry.first.Mark().line + 1, cameras.back().name);
            }
        }
    } catch (const YAML::Exception& exception) {
        return absl::InvalidArgumentError(
            one_line(fmt::format("{}:{}: is not valid YAML: {}; correct the line", name_for_errors,
                                 exception.mark.line + 1, exception.msg)));
    }
    if (!error.empty()) return absl::InvalidArgumentError(one_line(error));
    if (cameras.empty())
        return absl::InvalidArgumentError(fmt::format(
            "{}: holds no camera; see common/calibration_file.h for the layout", name_for_errors));
    return cameras;
}

std::string calibration_opencv_yaml(const std::vector<Camera>& cameras) {
    const auto matrix = [](const char* key, int rows, int columns, const std::vector<double>& values) {
        std::vector<std::string> words;
        for (const double value : values) words.push_back(toml_number(value));
        return fmt::format(
            "   {}: !!opencv-matrix\n      rows: {}\n      cols: {}\n      dt: d\n      data: [ {} ]\n", key,
            rows, columns, fmt::join(words, ", "));
    };
    // OpenCV's reader knows no quotes around keys; names that need them are for other readers.
    const auto key = [](const std::string& name) {
        const bool letter =
            !name.empty() && (std::isalpha(static_cast<unsigned char>(name[0])) || name[0] == '_');
        const auto plain = [](unsigned char ch) {
            return std::isalnum(ch) || ch == '_' || ch == '-' || ch == ' ';
        };
        return letter && name.back() != ' ' && std::all_of(name.begin(), name.end(), plain)
                   ? name
                   : toml_quoted(name);
    };
    std::string out = "%YAML:1.0\n---\n";
    for (const Camera& c : cameras) {
        const Rigid3& t = c.camera_from_world;
        out += fmt::format("{}:\n   image_width: {}\n   image_height: {}\n", key(c.name), c.width, c.height);
        out += matrix("camera_matrix", 3, 3, {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
        out += matrix("distortion_coefficients", 1, 5, {c.k1, c.k2, c.p1, c.p2, c.k3});
        out += matrix("rotation", 3, 3, {t.rotation.m.begin(), t.rotation.m.end()});
        out += matrix("translation", 3, 1, {t.translation.x, t.translation.y, t.translation.z});
    }
    return out;
}

}  // namespace kinevox
