#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>

#include "common/live_camera_config.h"
#include "common/toml_reader.h"
#include "server/config/config_reader.h"

namespace kinevox {
namespace {

using Trigger = LiveSourceConfig::Trigger;

constexpr std::array<std::string_view, 3> kWhiteBalances{"off", "once", "continuous"};

void read_settings(const TomlTable& table, CameraSettings& settings) {
    settings.pixel_format = table.text_or("pixel_format", settings.pixel_format);
    if (table.has("exposure_us")) settings.exposure_us = table.number("exposure_us", {1, 1e6});
    if (table.has("gain_db")) settings.gain_db = table.number("gain_db", {-20, 100});
    if (table.has("white_balance"))
        settings.white_balance = table.choice_or("white_balance", "off", kWhiteBalances);
    if (table.has("white_balance_ratios")) {
        const auto ratios = table.numbers("white_balance_ratios", 3, 3, {0.05, 20});
        if (ratios.size() == 3) settings.white_balance_ratios = {ratios[0], ratios[1], ratios[2]};
    }
    if (table.has("sensor_offset_px")) {
        const auto offset = table.numbers("sensor_offset_px", 2, 2, {0, 65535});
        if (offset.size() == 2)
            settings.sensor_offset_px = {static_cast<int>(offset[0]), static_cast<int>(offset[1])};
    }
}

void check_cameras(const TomlTable& table, bool check_files_exist, const LiveSourceConfig& cameras) {
    if (cameras.calibration_file.empty())
        table.fail("calibration_file",
                   "is missing, but kind is \"cameras\"; give the calibration file of the cameras");
    if (check_files_exist)
        require_file(table, "calibration_file", cameras.calibration_file, "correct the path");
    if (cameras.cameras.empty())
        table.fail("camera",
                   "is missing, but kind is \"cameras\"; add a [[source.cameras.camera]] for each camera");
    for (std::size_t a = 0; a < cameras.cameras.size(); ++a)
        for (std::size_t b = 0; b < a; ++b)
            for (std::string LiveCameraConfig::*key : {&LiveCameraConfig::name, &LiveCameraConfig::device})
                if (cameras.cameras[a].*key == cameras.cameras[b].*key)
                    table.fail("camera", fmt::format("\"{}\" occurs twice; give each camera its own",
                                                     cameras.cameras[a].*key));
    if (cameras.trigger == Trigger::kCamera &&
        std::ranges::find(cameras.cameras, cameras.trigger_camera, &LiveCameraConfig::name) ==
            cameras.cameras.end())
        table.fail(
            "trigger_camera",
            fmt::format("is \"{}\", which is no [[source.cameras.camera]]; give the name of the camera "
                        "that triggers the others",
                        cameras.trigger_camera));
}

}  // namespace

void read_live_cameras(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                       bool required, LiveSourceConfig& cameras) {
    read_options(table, folder, cameras);
    if (cameras.packet_size_bytes > 0 && cameras.packet_size_bytes < 576)
        table.fail("packet_size_bytes",
                   fmt::format("is {}, expected 576 to 16000, or 0 for the largest that arrives; "
                               "correct it",
                               cameras.packet_size_bytes));
    CameraSettings common;
    read_settings(table, common);
    for (const TomlTable& entry : table.tables("camera")) {
        LiveCameraConfig camera{entry.text("name"), entry.text("device"), common};
        read_settings(entry, camera.settings);
        cameras.cameras.push_back(std::move(camera));
    }
    if (required) check_cameras(table, check_files_exist, cameras);
}

}  // namespace kinevox
