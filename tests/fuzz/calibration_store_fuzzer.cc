#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "server/calibration/procedure/calibration_store.h"
#include "tests/fuzz/fuzz_check.h"
#include "tests/fuzz/fuzzed_folder.h"

namespace {

using namespace kinevox;

std::vector<Camera> own_cameras() {
    Camera camera;
    camera.name = "cam1";
    camera.width = camera.height = 8;
    camera.fx = camera.fy = 10;
    camera.cx = camera.cy = 4;
    return {camera};
}

struct StoredFile {
    const char *name, *good;
};
constexpr StoredFile kFiles[] = {
    {"c1/calibration.json", R"({"method": "board", "cameras": [{"name": "cam1", "width": 8, "height": 8}]})"},
    {"c1/calibration.toml",
     "[cam1]\nname = \"cam1\"\nsize = [8, 8]\nmatrix = [[10.0, 0, 4], [0, 10.0, 4], [0, 0, 1]]\n"
     "distortions = [0, 0, 0, 0]\nrotation = [0.1, 0, 0]\ntranslation = [0, 0, 3.0]\nfisheye = false\n"},
    {"c1/certificate.json", "{}"},
    {"active.json", "{}"},
};

void use(testing::FuzzedFolder& folder) {
    CalibrationStore store(folder.path(), "fuzzed", own_cameras());
    const auto all = store.list();
    FUZZ_CHECK(all.ok() && all->size() <= 1);
    const auto found = store.find("c1");
    FUZZ_CHECK(found.ok() == !all->empty());
    const auto fitting = store.compatible_cameras("c1");
    FUZZ_CHECK(fitting.status().message().find('\n') == absl::string_view::npos);
    if (fitting.ok()) FUZZ_CHECK(fitting->size() == 1 && fitting->front().name == "cam1");
    // Whatever the files contain: a calibration that is applied afterwards is active, and can be undone.
    const std::string before = store.active();
    if (!store.apply("c1").ok()) return;
    FUZZ_CHECK(store.active() == "c1" && !store.remove("c1").ok());
    if (before == "c1") return;
    const auto undone = store.undo();
    FUZZ_CHECK(undone.ok() && *undone == before);
}

}  // namespace

// A store in which one file is arbitrary.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static testing::FuzzedFolder folder;
    std::filesystem::create_directories(folder.path() / "c1");
    for (const StoredFile& damaged : kFiles) {
        for (const StoredFile& file : kFiles) folder.write(file.name, file.good);
        folder.write(damaged.name, {reinterpret_cast<const char*>(data), size});
        use(folder);
    }
    return 0;
}
