#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>

#include "common/calibration_file.h"
#include "common/one_line.h"
#include "common/toml_reader.h"

namespace kinevox {
namespace {

// Reads one camera's keys and keeps the first error.
class CameraReader {
  public:
    CameraReader(const YAML::Node& map, std::string camera, std::string file, std::string& error)
        : map_(map), camera_(std::move(camera)), file_(std::move(file)), error_(error) {}

    // `count` finite numbers within +-1e6; nested sequences count row after row. Zeros if anything is wrong.
    std::vector<double> numbers(const char* key, std::size_t count) {
        std::vector<double> values;
        bool good = map_[key].IsDefined();
        if (good) collect(map_[key], values, good);
        if (good && values.size() == count) return values;
        wrong(key, fmt::format("is missing or not {} numbers; correct it", count));
        return std::vector<double>(count, 0.0);
    }

    std::string word(const char* key) {
        const YAML::Node node = map_[key];
        if (node.IsDefined() && node.IsScalar()) return node.Scalar();
        wrong(key, "is missing; add it");
        return {};
    }

    void wrong(const char* key, const std::string& what) {
        const YAML::Node node = map_[key];
        const int line = (node.IsDefined() ? node.Mark() : map_.Mark()).line + 1;
        if (error_.empty()) error_ = fmt::format("{}:{}: key '{}.{}' {}", file_, line, camera_, key, what);
    }

  private:
    static void collect(const YAML::Node& node, std::vector<double>& values, bool& good) {
        if (node.IsSequence()) {
            for (const YAML::Node& element : node) collect(element, values, good);
            return;
        }
        double value = 0;
        good = good && values.size() < 64 && node.IsScalar() && YAML::convert<double>::decode(node, value) &&
               std::abs(value) <= 1e6;
        values.push_back(value);
    }

    YAML::Node map_;
    std::string camera_, file_;
    std::string& error_;
};

Rigid3 read_transform(CameraReader& reader) {
    const std::vector<double> t = reader.numbers("T_cn_cnm1", 16);
    Rigid3 out;
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column) out.rotation(row, column) = t[4 * row + column];
    out.translation = {t[3], t[7], t[11]};
    const Mat3& r = out.rotation;
    const Mat3 square = r * r.transposed();
    bool proper =
        dot({r(0, 0), r(0, 1), r(0, 2)}, cross({r(1, 0), r(1, 1), r(1, 2)}, {r(2, 0), r(2, 1), r(2, 2)})) > 0;
    for (int i = 0; i < 9; ++i) proper = proper && std::abs(square.m[i] - (i % 4 == 0)) < 1e-4;
    if (!proper || !(norm(out.translation) <= 1000))
        reader.wrong("T_cn_cnm1", "is not a rigid transform in metres; correct it");
    return proper ? out : Rigid3{};
}

Camera read_camera(const YAML::Node& map, const std::string& name, const Rigid3* before_from_world,
                   const std::string& file, std::string& error) {
    CameraReader reader(map, name, file, error);
    Camera camera;
    camera.name = name;
    if (const std::string model = reader.word("camera_model"); model != "pinhole")
        reader.wrong("camera_model",
                     fmt::format("is '{}'; only pinhole is read: calibrate with it", model.substr(0, 40)));
    const std::string distortion = reader.word("distortion_model");
    if (distortion != "radtan" && distortion != "none")
        reader.wrong("distortion_model", fmt::format("is '{}'; only radtan and none are read: calibrate with "
                                                     "one of them",
                                                     distortion.substr(0, 40)));
    const std::vector<double> size = reader.numbers("resolution", 2);
    for (const double side : size)
        if (!(side >= 1 && side <= kMaxImagePx && side == std::floor(side)))
            reader.wrong("resolution", fmt::format("is not two whole numbers from 1 to {}; write [width, "
                                                   "height] in px",
                                                   kMaxImagePx));
    if (!error.empty()) return camera;
    camera.width = static_cast<int>(size[0]), camera.height = static_cast<int>(size[1]);
    const std::vector<double> in = reader.numbers("intrinsics", 4);
    if (!(in[0] > 0 && in[1] > 0)) reader.wrong("intrinsics", "has a focal length that is not positive");
    camera.fx = in[0], camera.fy = in[1], camera.cx = in[2], camera.cy = in[3];
    if (distortion == "radtan") {
        const std::vector<double> d = reader.numbers("distortion_coeffs", 4);
        camera.k1 = d[0], camera.k2 = d[1], camera.p1 = d[2], camera.p2 = d[3];
        for (const double value : d)
            if (std::abs(value) > 1e4) reader.wrong("distortion_coeffs", "is absurdly large; correct it");
    }
    if (before_from_world) camera.camera_from_world = read_transform(reader) * *before_from_world;
    return camera;
}

}  // namespace

absl::StatusOr<std::vector<Camera>> parse_calibration_kalibr(const std::string& text,
                                                             const std::string& name_for_errors) {
    std::vector<Camera> cameras;
    std::string error;
    try {
        const YAML::Node root = YAML::Load(text);
        for (int n = 0; root.IsMap() && error.empty(); ++n) {
            const std::string name = fmt::format("cam{}", n);
            const YAML::Node map = root[name];
            if (!map.IsDefined()) break;
            if (!map.IsMap()) {
                error = fmt::format("{}:{}: {} is not a map of a camera's values; correct it",
                                    name_for_errors, map.Mark().line + 1, name);
                break;
            }
            cameras.push_back(read_camera(map, name, n == 0 ? nullptr : &cameras.back().camera_from_world,
                                          name_for_errors, error));
            if (error.empty() && !(norm(cameras.back().camera_from_world.translation) <= 1000))
                error = fmt::format("{}: {} is more than 1000 m from cam0; T_cn_cnm1 is in metres",
                                    name_for_errors, name);
        }
        if (error.empty() && cameras.size() != (root.IsMap() ? root.size() : 0))
            error = fmt::format(
                "{}: holds {} entries, of which cam0 to cam{} are cameras in a row; name them "
                "cam0, cam1, ...",
                name_for_errors, root.size(), static_cast<int>(cameras.size()) - 1);
    } catch (const YAML::Exception& exception) {
        error = fmt::format("{}:{}: is not valid YAML: {}; correct the line", name_for_errors,
                            exception.mark.line + 1, exception.msg);
    }
    if (error.empty() && cameras.empty())
        error = fmt::format("{}: holds no camera; a Kalibr camchain has cam0, cam1, ...", name_for_errors);
    if (!error.empty()) return absl::InvalidArgumentError(one_line(error));
    return cameras;
}

std::string kalibr_problem(const std::vector<Camera>& cameras) {
    for (const Camera& camera : cameras)
        if (camera.k3 != 0)
            return fmt::format(
                "camera {} has k3 = {:g}, which Kalibr's format cannot hold; calibrate it without k3 or "
                "export to opencv",
                camera.name, camera.k3);
    return "";
}

std::string calibration_kalibr_yaml(const std::vector<Camera>& cameras) {
    std::string out;
    const auto n = [](double value) { return toml_number(value); };
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Camera& camera = cameras[c];
        out += fmt::format("cam{}:  # {}\n", c, one_line(camera.name));
        if (c > 0) {
            const Rigid3 t = camera.camera_from_world * cameras[c - 1].camera_from_world.inverse();
            const double shift[3] = {t.translation.x, t.translation.y, t.translation.z};
            out += "  T_cn_cnm1:\n";
            for (int row = 0; row < 3; ++row)
                out += fmt::format("  - [{}, {}, {}, {}]\n", n(t.rotation(row, 0)), n(t.rotation(row, 1)),
                                   n(t.rotation(row, 2)), n(shift[row]));
            out += "  - [0.0, 0.0, 0.0, 1.0]\n";
        }
        out += fmt::format(
            "  camera_model: pinhole\n  distortion_coeffs: [{}, {}, {}, {}]\n  distortion_model: radtan\n"
            "  intrinsics: [{}, {}, {}, {}]\n  resolution: [{}, {}]\n",
            n(camera.k1), n(camera.k2), n(camera.p1), n(camera.p2), n(camera.fx), n(camera.fy), n(camera.cx),
            n(camera.cy), camera.width, camera.height);
    }
    return out;
}

}  // namespace kinevox
