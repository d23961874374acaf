// usage: make_pose_seeds bvh|pose_database FOLDER
// Writes seeds of bvh_fuzzer and pose_database_fuzzer: a small BVH file, and the fields of a small database.
#include <cstdio>
#include <cstring>
#include <string>

#include "common/files.h"
#include "server/pose/database/database_file.h"
#include "tests/fuzz/small_pose_options.h"
#include "tests/support/small_bvh.h"

namespace {

using namespace kinevox;

kernels::CameraModel camera() {
    kernels::CameraModel camera;
    camera.width = 640, camera.height = 480;
    camera.fx = camera.fy = 500, camera.cx = 319.5, camera.cy = 239.5;
    const float rotation[9] = {0, -1, 0, 0, 0, -1, 1, 0, 0};  // along x, one metre up
    std::copy(rotation, rotation + 9, camera.rotation_camera_from_world);
    const float translation[3] = {0, 1, 4};
    std::copy(translation, translation + 3, camera.translation_camera_from_world);
    return camera;
}

// Without the header, which the fuzzer writes.
absl::Status write_database(const std::filesystem::path& folder) {
    const kernels::CameraModel cameras[] = {camera()};
    const auto database = build_pose_database(cameras, default_body_shape(), testing::small_pose_options());
    if (!database.ok()) return database.status();
    const auto file = folder / "small.kvxposes";
    if (absl::Status written = write_pose_database(*database, file); !written.ok()) return written;
    auto bytes = read_file(file);
    if (!bytes.ok()) return bytes.status();
    return write_file_atomically(file, bytes->substr(pose_database_header("").size()));
}

}  // namespace

int main(int argc, char** argv) {
    absl::Status status = absl::InvalidArgumentError("usage: make_pose_seeds bvh|pose_database FOLDER");
    if (argc == 3 && !std::strcmp(argv[1], "bvh"))
        status = write_file_atomically(std::filesystem::path(argv[2]) / "small.bvh", testing::small_bvh(3));
    else if (argc == 3 && !std::strcmp(argv[1], "pose_database"))
        status = write_database(argv[2]);
    if (!status.ok()) return std::fprintf(stderr, "%s\n", std::string(status.message()).c_str()), 1;
}
