#include "server/cameras/aravis/aravis_camera.h"

#include <fmt/format.h>

#include <functional>

#include "server/cameras/aravis/pixel_format.h"

namespace kinevox {
namespace {

using Trigger = LiveSourceConfig::Trigger;

// Applies settings and keeps the first error.
class Settings {
  public:
    Settings(ArvCamera* camera, const std::string& name) : camera_(camera), name_(name) {}

    template <typename Call, typename... Arguments>
    void set(const std::string& key, const std::string& value, Call call, Arguments... arguments) {
        if (!status_.ok()) return;
        GCatch error;
        call(camera_, arguments..., error);
        if (error.caught())
            status_ = absl::InvalidArgumentError(
                fmt::format("camera {}: {} = {} was rejected: {}; correct or remove it in [source.cameras]",
                            name_, key, value, error.message()));
    }
    bool has(const char* feature) {
        GCatch error;
        return arv_camera_is_feature_available(camera_, feature, error) && !error.caught();
    }
    // Sets it to "Off" if it exists.
    void off(const char* feature) {
        if (has(feature)) set(feature, "Off", arv_camera_set_string, feature, "Off");
    }
    void fail(std::string message) {
        if (status_.ok()) status_ = absl::InvalidArgumentError(fmt::format("camera {}: {}", name_, message));
    }
    absl::Status status() const { return status_; }

  private:
    ArvCamera* camera_;
    const std::string& name_;
    absl::Status status_;
};

void set_image(Settings& settings, ArvCamera* camera, const CameraSettings& wanted, int width, int height) {
    if (!wanted.pixel_format.empty())
        settings.set("pixel_format", wanted.pixel_format, arv_camera_set_pixel_format_from_string,
                     wanted.pixel_format.c_str());
    GCatch error;
    const auto format = static_cast<std::uint32_t>(arv_camera_get_pixel_format(camera, error));
    if (!error.caught() && !is_known_pixel_format(format))
        settings.fail(fmt::format("pixel format {} is not supported; set pixel_format to one of {}",
                                  text_of(arv_camera_get_pixel_format_as_string(camera, error)),
                                  kKnownPixelFormats));
    const auto offset = wanted.sensor_offset_px.value_or(std::array<int, 2>{0, 0});
    const std::string region = fmt::format("[{}, {}] and {} x {} px", offset[0], offset[1], width, height);
    // Resets the offset first, so that the size fits whatever the offset was.
    if (settings.has("OffsetX"))
        settings.set("sensor_offset_px", region, arv_camera_set_integer, "OffsetX", gint64{0});
    if (settings.has("OffsetY"))
        settings.set("sensor_offset_px", region, arv_camera_set_integer, "OffsetY", gint64{0});
    settings.set("the calibration's size", region, arv_camera_set_region, -1, -1, width, height);
    if (offset[0] != 0 || offset[1] != 0)
        settings.set("sensor_offset_px", region, arv_camera_set_region, offset[0], offset[1], width, height);
    int x = 0, y = 0, has_width = 0, has_height = 0;
    arv_camera_get_region(camera, &x, &y, &has_width, &has_height, error);
    if (!error.caught() && (has_width != width || has_height != height))
        settings.fail(
            fmt::format("images are {} x {} px, the calibration is for {} x {}; recalibrate at this size",
                        has_width, has_height, width, height));
}

void set_light(Settings& settings, const CameraSettings& wanted) {
    if (wanted.exposure_us) {
        settings.off("ExposureAuto");
        settings.set("exposure_us", fmt::format("{}", *wanted.exposure_us), arv_camera_set_exposure_time,
                     *wanted.exposure_us);
    }
    if (wanted.gain_db) {
        settings.off("GainAuto");
        settings.set("gain_db", fmt::format("{}", *wanted.gain_db), arv_camera_set_gain, *wanted.gain_db);
    }
    if (!wanted.white_balance.empty()) {
        const char* value = wanted.white_balance == "off"    ? "Off"
                            : wanted.white_balance == "once" ? "Once"
                                                             : "Continuous";
        settings.set("white_balance", wanted.white_balance, arv_camera_set_string, "BalanceWhiteAuto", value);
    }
    if (wanted.white_balance_ratios) {
        settings.off("BalanceWhiteAuto");
        const char* channels[] = {"Red", "Green", "Blue"};
        for (int i = 0; i < 3; ++i) {
            const double ratio = (*wanted.white_balance_ratios)[i];
            settings.set("white_balance_ratios", channels[i], arv_camera_set_string, "BalanceRatioSelector",
                         channels[i]);
            settings.set("white_balance_ratios", fmt::format("{}", ratio), arv_camera_set_float,
                         "BalanceRatio", ratio);
        }
    }
}

void set_timing(Settings& settings, const LiveSourceConfig& config, const std::string& name) {
    if (settings.has("AcquisitionMode"))
        settings.set("AcquisitionMode", "Continuous", arv_camera_set_string, "AcquisitionMode", "Continuous");
    const bool is_trigger_camera = config.trigger == Trigger::kCamera && name == config.trigger_camera;
    if (config.trigger == Trigger::kFreeRun || is_trigger_camera) {
        settings.set("trigger", "free_run", arv_camera_clear_triggers);
        settings.set("fps", fmt::format("{}", config.fps), arv_camera_set_frame_rate, config.fps);
    } else {
        const std::string source =
            config.trigger == Trigger::kSoftware ? "Software" : config.trigger_input_line;
        settings.set("trigger", source, arv_camera_set_trigger, source.c_str());
    }
    if (is_trigger_camera) {
        settings.set("trigger_output_line", config.trigger_output_line, arv_camera_set_string, "LineSelector",
                     config.trigger_output_line.c_str());
        if (settings.has("LineMode"))
            settings.set("trigger_output_line", "Output", arv_camera_set_string, "LineMode", "Output");
        settings.set("trigger_output_line", "ExposureActive", arv_camera_set_string, "LineSource",
                     "ExposureActive");
    }
}

// The current name in the standard, else its predecessor.
const char* ptp_feature(ArvCamera* camera, const char* name, const char* old_name) {
    for (const char* feature : {name, old_name}) {
        GCatch error;
        if (arv_camera_is_feature_available(camera, feature, error) && !error.caught()) return feature;
    }
    return nullptr;
}

}  // namespace

absl::Status apply_settings(ArvCamera* camera, const LiveSourceConfig& config, const LiveCameraConfig& of,
                            int width, int height) {
    Settings settings(camera, of.name);
    set_image(settings, camera, of.settings, width, height);
    set_light(settings, of.settings);
    set_timing(settings, config, of.name);
    return settings.status();
}

void enable_ptp(ArvCamera* camera) {
    GCatch error;
    if (const char* feature = ptp_feature(camera, "PtpEnable", "GevIEEE1588"))
        arv_camera_set_boolean(camera, feature, TRUE, error);
}

bool has_ptp_time(ArvCamera* camera) {
    GCatch error;
    if (const char* latch = ptp_feature(camera, "PtpDataSetLatch", "GevIEEE1588DataSetLatch"))
        arv_camera_execute_command(camera, latch, error);
    const char* feature = ptp_feature(camera, "PtpStatus", "GevIEEE1588Status");
    if (!feature) return false;
    const std::string status = text_of(arv_camera_get_string(camera, feature, error));
    return !error.caught() && (status == "Slave" || status == "Master");
}

}  // namespace kinevox
