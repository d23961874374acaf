// What users get wrong in files, and that the answer says which file, which line, which key and what to do.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "common/toml_reader.h"
#include "server/config/daemon_config.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

struct BadInput {
    const char* what;
    const char* replaced;     // this text in the good file ...
    const char* replacement;  // ... becomes this
    std::vector<const char*> words;
    absl::StatusCode code = absl::StatusCode::kInvalidArgument;
};

std::string with(std::string text, const BadInput& bad) {
    const std::size_t at = text.find(bad.replaced);
    EXPECT_NE(at, std::string::npos) << bad.what;
    return text.replace(at, std::string(bad.replaced).size(), bad.replacement);
}

void expect_words(const absl::Status& status, const BadInput& bad) {
    SCOPED_TRACE(bad.what);
    EXPECT_EQ(status.code(), bad.code) << status;
    const std::string message{status.message()};
    for (const char* word : bad.words) EXPECT_THAT(message, HasSubstr(word));
    EXPECT_THAT(message, Not(HasSubstr("\n")));
}

const char kCalibration[] = R"(# two cameras
[left]
name = "left"
size = [640.0, 480.0]
matrix = [[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [0.1, 0.2, 0.3]
translation = [0.0, 0.0, 3.0]
fisheye = false
[right]
size = [640.0, 480.0]
matrix = [[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [0.1, 0.2, 0.3]
translation = [0.0, 0.0, 4.0]
)";

TEST(BadInput, Calibration) {
    ASSERT_TRUE(parse_calibration_toml(kCalibration, "c.toml").ok());
    const BadInput table[] = {
        {"NaN", "600.0, 0.0, 319.5", "600.0, 0.0, nan", {"c.toml:5:", "'left.matrix'", "nan", "finite"}},
        {"infinite",
         "translation = [0.0, 0.0, 3.0]",
         "translation = [0.0, inf, 3.0]",
         {"c.toml:8:", "'left.translation'", "inf", "finite"}},
        {"two of one name in [ ]", "[right]", "[left]", {"c.toml:10:", "left"}},
        {"two of one name",
         "[right]",
         "[right]\nname = \"left\"",
         {"c.toml:10:", "'right'", "\"left\"", "its own"}},
        {"no camera", kCalibration, "", {"c.toml:", "no camera", "add"}},
        {"only metadata", kCalibration, "[metadata]\nerror = 1\n", {"c.toml:", "no camera", "add"}},
        {"size of three", "[640.0, 480.0]", "[640.0, 480.0, 3.0]", {"c.toml:4:", "'left.size'", "2 numbers"}},
        {"size in words",
         "[640.0, 480.0]",
         "\"640x480\"",
         {"c.toml:4:", "'left.size'", "640x480", "2 numbers"}},
        {"size of zero", "[640.0, 480.0]", "[0, 480]", {"c.toml:4:", "'left.size'", "0"}},
        {"size not whole", "[640.0, 480.0]", "[640.5, 480]", {"c.toml:4:", "'left.size'", "whole"}},
        {"matrix of two rows", ", [0.0, 0.0, 1.0]]", "]", {"c.toml:5:", "'left.matrix'", "3 rows"}},
        {"skew", "600.0, 0.0, 319.5", "600.0, 2.0, 319.5", {"c.toml:5:", "'left.matrix'", "skew"}},
        {"negative focal length", "[600.0,", "[-600.0,", {"c.toml:5:", "'left.matrix'", "-600", "focal"}},
        {"three distortions",
         "[0.0, 0.0, 0.0, 0.0]",
         "[0.0, 0.0, 0.0]",
         {"c.toml:6:", "'left.distortions'", "4 to 5"}},
        {"degrees", "[0.1, 0.2, 0.3]", "[10, 20, 30]", {"c.toml:7:", "'left.rotation'", "radians"}},
        {"millimetres", "0.0, 3.0]", "0.0, 3000.0]", {"c.toml:8:", "'left.translation'", "3000", "mm"}},
        {"fisheye",
         "fisheye = false",
         "fisheye = true",
         {"c.toml:9:", "'left.fisheye'", "not supported", "pinhole"}},
        {"unknown key", "fisheye", "fish_eye", {"c.toml:9:", "'left.fish_eye'", "unknown", "fisheye"}},
        {"missing key", "rotation = [0.1, 0.2, 0.3]", "", {"c.toml:2:", "'left.rotation'", "missing"}},
        {"misspelt key", "rotation", "rotaton", {"c.toml:7:", "'left.rotaton'", "unknown", "rotation"}},
        {"a name that leaves the folder", "[left]", "[\"../left\"]", {"c.toml:2:", "begins with a dot"}},
        {"a loose value", "[left]", "x = 1\n[left]", {"c.toml:2:", "'x'", "expected a table"}},
        {"no TOML", "[left]", "[left", {"c.toml:2:", "no valid TOML"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_calibration_toml(with(kCalibration, bad), "c.toml").status(), bad);
}

TEST(BadInput, CalibrationFiles) {
    const testing::TemporaryFolder folder;
    EXPECT_EQ(read_calibration(folder / "none.toml").status().code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(read_calibration(folder / "none.toml").status().message()),
                HasSubstr("none.toml"));
    EXPECT_THAT(std::string(read_calibration(folder.write("c.json", "{}")).status().message()),
                HasSubstr(".toml"));
    std::filesystem::create_directory(folder / "folder.toml");
    EXPECT_THAT(std::string(read_calibration(folder / "folder.toml").status().message()),
                HasSubstr("not a file"));
}

const char kQualisys[] = R"(<calibration><cameras>
<camera active="1" serial="cam_01">
<fov_video bottom="479" left="0" right="639" top="0"/>
<transform r11="1" r12="0" r13="0" r21="0" r22="1" r23="0" r31="0" r32="0" r33="1" x="0" y="0" z="1000"/>
<intrinsic centerPointU="20480" centerPointV="15360" focalLengthU="38400" focalLengthV="38400" radialDistortion1="0"
 radialDistortion2="0" radialDistortion3="0" tangentalDistortion1="0" tangentalDistortion2="0"/>
</camera>
</cameras></calibration>
)";

TEST(BadInput, QualisysCalibration) {
    const auto good = parse_calibration_qualisys(kQualisys, "q.txt");
    ASSERT_TRUE(good.ok()) << good.status();
    EXPECT_EQ((*good)[0].width, 640);
    EXPECT_EQ((*good)[0].camera_from_world.translation,
              (Vec3{0, 0, 1}));  // looks down the world's z from 1 m
    const BadInput table[] = {
        {"missing attribute", "r22=\"1\"", "", {"q.txt:2:", "<transform>", "r22", "missing"}},
        {"NaN", "x=\"0\"", "x=\"nan\"", {"q.txt:2:", "<transform>", "nan", "finite"}},
        {"no rotation", "r33=\"1\"", "r33=\"2\"", {"q.txt:2:", "not a rotation"}},
        {"mirrored", "r33=\"1\"", "r33=\"-1\"", {"q.txt:2:", "not a rotation"}},
        {"no intrinsics", "<intrinsic", "<extrinsic", {"q.txt:2:", "<intrinsic> is missing"}},
        {"no cameras", "cameras>", "kameras>", {"q.txt"}},
        {"not active", "active=\"1\"", "active=\"0\"", {"q.txt", "no active <camera>"}},
        {"cut off", "</camera>\n</cameras></calibration>", "", {"q.txt:", "XML"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_calibration_qualisys(with(kQualisys, bad), "q.txt").status(), bad);
}

const char kOpenCv[] = R"(%YAML:1.0
---
left:
   image_width: 640
   image_height: 480
   camera_matrix: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [600., 0., 319.5, 0., 600., 239.5, 0., 0., 1.]}
   distortion_coefficients: !!opencv-matrix {rows: 5, cols: 1, dt: d, data: [0., 0., 0., 0., 0.]}
   rotation: !!opencv-matrix {rows: 3, cols: 1, dt: d, data: [0., 0., 1.]}
   translation: !!opencv-matrix {rows: 3, cols: 1, dt: d, data: [0., 0., 3.]}
)";

TEST(BadInput, OpenCvCalibration) {
    const auto good = parse_calibration_opencv(kOpenCv, "c.yml");
    ASSERT_TRUE(good.ok()) << good.status();
    const BadInput table[] = {
        {"NaN", "319.5", ".Nan", {"c.yml:6:", "camera_matrix", "finite"}},
        {"no width", "image_width", "image_widht", {"c.yml:", "image_width", "missing"}},
        {"too few", "data: [0., 0., 1.]", "data: [0., 1.]", {"c.yml:8:", "rotation", "3 or 9"}},
        {"degrees", "data: [0., 0., 1.]", "data: [0., 0., 90.]", {"c.yml:8:", "rotation", "radians"}},
        {"millimetres", "0., 3.]", "0., 3000.]", {"c.yml:9:", "translation", "mm"}},
        {"no YAML", "{rows: 3, cols: 3", "{rows: [3, cols: 3", {"c.yml:", "YAML"}},
        {"no camera", kOpenCv, "%YAML:1.0\n---\na: 1\n", {"c.yml", "no camera"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_calibration_opencv(with(kOpenCv, bad), "c.yml").status(), bad);
}

const char kKalibr[] = R"(cam0:
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [460.1, 459.8, 367.2, 248.4]
  resolution: [752, 480]
cam1:
  T_cn_cnm1: [[1.0, 0.0, 0.0, -0.11], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [458.1, 457.8, 379.2, 255.4]
  resolution: [752, 480]
)";

TEST(BadInput, KalibrCalibration) {
    const auto good = parse_calibration_kalibr(kKalibr, "k.yaml");
    ASSERT_TRUE(good.ok()) << good.status();
    EXPECT_NEAR((*good)[1].centre_in_world().x, 0.11, 1e-12);
    const BadInput table[] = {
        {"NaN", "460.1", ".nan", {"k.yaml:5:", "cam0.intrinsics", "4 numbers"}},
        {"fisheye",
         "model: radtan",
         "model: equidistant",
         {"k.yaml:4:", "cam0.distortion_model", "equidistant"}},
        {"omnidirectional", "model: pinhole", "model: omni", {"k.yaml:2:", "cam0.camera_model", "omni"}},
        {"no size", "resolution", "revolution", {"k.yaml", "cam0.resolution"}},
        {"no rotation", "[[1.0, 0.0", "[[2.0, 0.0", {"k.yaml:8:", "cam1.T_cn_cnm1", "rigid"}},
        {"a gap", "cam1:", "cam2:", {"k.yaml", "cam0, cam1"}},
        {"no YAML", "[460.1", "[[460.1", {"k.yaml:", "YAML"}},
        {"no camera", kKalibr, "camera_model: 1\n", {"k.yaml", "cam0"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_calibration_kalibr(with(kKalibr, bad), "k.yaml").status(), bad);
}

const char kSession[] = R"(name = "trial"
fps = 60.0
calibration = "calibration.toml"
[[camera]]
name = "left"
video = "left.mp4"
background = "left.png"
[[camera]]
name = "right"
video = "right.mp4"
)";

TEST(BadInput, Session) {
    const testing::TemporaryFolder folder;
    for (const char* name : {"calibration.toml", "left.mp4", "left.png", "right.mp4"}) folder.write(name, "");
    ASSERT_TRUE(parse_session_toml(kSession, folder.path(), "s.toml", true).ok());
    const BadInput table[] = {
        {"missing video",
         "right.mp4",
         "rihgt.mp4",
         {"s.toml:10:", "'camera.video'", "rihgt.mp4", "does not exist"},
         absl::StatusCode::kNotFound},
        {"missing background",
         "left.png",
         "none.png",
         {"s.toml:7:", "'camera.background'", "none.png"},
         absl::StatusCode::kNotFound},
        {"missing calibration",
         "calibration.toml",
         "c.toml",
         {"s.toml:3:", "'calibration'", "c.toml"},
         absl::StatusCode::kNotFound},
        {"missing truth",
         "fps",
         "truth = \"truth\"\nfps",
         {"s.toml:2:", "'truth'"},
         absl::StatusCode::kNotFound},
        {"two of one name", "\"right\"", "\"left\"", {"s.toml:9:", "'camera.name'", "\"left\"", "unique"}},
        {"no camera",
         kSession,
         "name = \"a\"\nfps = 1\ncalibration = \"calibration.toml\"\n",
         {"s.toml", "no camera", "[[camera]]"}},
        {"one bracket",
         "[[camera]]\nname = \"left\"\nvideo = \"left.mp4\"\nbackground = \"left.png\"\n[[camera]]",
         "[camera]",
         {"s.toml:4:", "'camera'", "[[camera]]"}},
        {"no speed", "fps = 60.0", "fps = 0", {"s.toml:2:", "'fps'", "0"}},
        {"speed in words", "fps = 60.0", "fps = \"60\"", {"s.toml:2:", "'fps'", "the text \"60\"", "number"}},
        {"speed unknown", "fps = 60.0", "fps = nan", {"s.toml:2:", "'fps'", "nan"}},
        {"unknown key", "fps = 60.0", "fps = 60.0\nframes = 3", {"s.toml:3:", "'frames'", "unknown"}},
        {"unknown key of a camera",
         "background",
         "backround",
         {"s.toml:7:", "'camera.backround'", "background"}},
        {"a path that is no text", "\"right.mp4\"", "5", {"s.toml:10:", "'camera.video'", "5", "text"}},
        {"an empty path", "\"right.mp4\"", "\"\"", {"s.toml:10:", "'camera.video'", "empty"}},
        {"a name with a slash", "\"right\"", "\"a/b\"", {"s.toml:9:", "'camera.name'", "slash"}},
        {"beyond ASCII",
         "fps = 60.0",
         "# größer\nfps = 60.0\ngröße = 3",
         {"s.toml:4:", "beyond ASCII", "quotes"}},
        {"no TOML", "fps = 60.0", "fps = ", {"s.toml:2:", "no valid TOML"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_session_toml(with(kSession, bad), folder.path(), "s.toml", true).status(), bad);
    EXPECT_EQ(read_session(folder / "none/session.toml").status().code(), absl::StatusCode::kNotFound);
}

// Characters beyond ASCII are welcome in comments and strings of every kind, and nowhere else.
TEST(BadInput, ReadsCharactersBeyondAsciiInTextsOnly) {
    const auto status_of = [](const std::string& text) {
        return TomlDocument::parse(text, "t.toml").status();
    };
    for (const char* good : {"",
                             "\xef\xbb\xbf"
                             "a = 'ö'",
                             "# ö", R"(a = "\"ö" # ö)", R"(a = '\' # 'ö)", "a = \'\'\'ö'ö''ö'\'\'\'\'",
                             R"(a = "ö\u00e4")", "a = \"\"\"\n\"ö\"\"\"\"", "a = \"\"\"\\\n  x ö\"\"\"",
                             "a.'ö'.\"ö\" = {'ö' = ['ö', \"ö\"]}\n['ö']"})
        EXPECT_TRUE(status_of(good).ok()) << good << ": " << status_of(good);
    for (const char* bad :
         {"ö = 1", "a = 1\xc2\xa0", "a = 'x' ö", "a = \'\'\'x\'\'\'ö", "a = \"\" ö", R"(a = "\ö")", "[ö]",
          R"(a = '\'ö')", "a = 5'ö'", "a = 'x' 'ö'", R"(a = 3."ö")", R"(a = n.'"' ö)", "a = '\xff'"}) {
        EXPECT_FALSE(status_of(bad).ok()) << bad;
        EXPECT_TRUE(std::string(status_of(bad).message()).starts_with("t.toml:1:")) << status_of(bad);
    }
}

TEST(BadInput, KeepsCharactersBeyondAscii) {
    const std::string text =
        "[\"Kämera 相机 \U0001F3A5\"]\nname = 'é\u2028\uFEFF'\nmore = [{ 'ß' = \"\\u00e4ö\" }]\n";
    const auto document = TomlDocument::parse(text, "t.toml");
    ASSERT_TRUE(document.ok()) << document.status();
    ASSERT_THAT((*document)->root().keys(), ::testing::ElementsAre("Kämera 相机 \U0001F3A5"));
    const TomlTable table = (*document)->root().table_or_empty("Kämera 相机 \U0001F3A5");
    EXPECT_EQ(table.text("name"), "é\u2028\uFEFF");
    EXPECT_EQ(table.tables("more").at(0).text("ß"), "äö");
    table.fail("name", "is noted");
    EXPECT_THAT(std::string((*document)->finish().message()),
                ::testing::HasSubstr("t.toml:2: key 'Kämera 相机"));
}

TEST(BadInput, SessionWhoseCameraIsNotCalibrated) {
    const testing::TemporaryFolder folder;
    folder.write("calibration.toml",
                 std::string(kCalibration).replace(std::string(kCalibration).find("[right]"), 7, "[middle]"));
    const auto session = parse_session_toml(kSession, folder.path(), "s.toml", false);
    ASSERT_TRUE(session.ok()) << session.status();
    const absl::Status status = read_session_cameras(*session).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
    for (const char* word : {"\"right\"", "calibration.toml", "left, middle"})
        EXPECT_THAT(std::string(status.message()), HasSubstr(word));
}

const char kConfig[] = R"([server]
listen = "127.0.0.1:50770"
[source]
kind = "studio"
[source.studio]
camera_count = 4
[pipeline]
voxel_mm = 10
[segmentation]
background_samples = 32
[log]
level = "info"
)";

TEST(BadInput, Config) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(parse_config_toml(kConfig, folder.path(), "k.toml", true).ok());
    const BadInput table[] = {
        {"unknown key", "voxel_mm", "voxel_cm", {"k.toml:8:", "'pipeline.voxel_cm'", "unknown", "voxel_mm"}},
        {"unknown table", "[log]", "[logging]", {"k.toml:11:", "'logging'", "unknown", "log"}},
        {"wrong type", "voxel_mm = 10", "voxel_mm = \"10\"", {"k.toml:8:", "'pipeline.voxel_mm'", "number"}},
        {"not whole",
         "background_samples = 32",
         "background_samples = 32.5",
         {"k.toml:10:", "'segmentation.background_samples'", "32.5", "whole"}},
        {"out of range", "voxel_mm = 10", "voxel_mm = 0.01", {"k.toml:8:", "0.01", "from 2 to 100"}},
        {"no such choice", "\"info\"", "\"loud\"", {"k.toml:12:", "'log.level'", "loud", "debug"}},
        {"no such motion",
         "camera_count = 4",
         "motion = \"fly\"",
         {"k.toml:6:", "'source.studio.motion'", "fly", "walk"}},
        {"zero cameras",
         "camera_count = 4",
         "camera_count = 0",
         {"k.toml:6:", "'source.studio.camera_count'", "0", "2 to 64"}},
        {"missing body",
         "[log]",
         "[pose]\nbody_file = \"none.toml\"\n[log]",
         {"k.toml:12:", "'pose.body_file'", "none.toml"},
         absl::StatusCode::kNotFound},
        {"no port", "127.0.0.1:50770", "127.0.0.1", {"k.toml:2:", "'server.listen'", "HOST:PORT"}},
        {"no session",
         "kind = \"studio\"",
         "kind = \"session\"",
         {"k.toml:3:", "'source.session_file'", "give the path"}},
        {"missing session",
         "kind = \"studio\"",
         "kind = \"session\"\nsession_file = \"a/s.toml\"",
         {"k.toml:5:", "'source.session_file'", "a/s.toml", "does not exist"},
         absl::StatusCode::kNotFound},
        {"a table that is a value",
         "[server]\nlisten = \"127.0.0.1:50770\"",
         "server = 3",
         {"k.toml:1:", "'server'", "3", "[server]"}},
        {"twice",
         "background_samples = 32",
         "background_samples = 32\nbackground_samples = 16",
         {"k.toml:11:", "samples"}},
        {"thresholds crossed",
         "background_samples = 32",
         "loose_threshold = 0.9",
         {"k.toml:10:", "0.9", "sharp_threshold"}},
    };
    for (const BadInput& bad : table)
        expect_words(parse_config_toml(with(kConfig, bad), folder.path(), "k.toml", true).status(), bad);
    EXPECT_EQ(read_config(folder / "none.toml").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace kinevox
