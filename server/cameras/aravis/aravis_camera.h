// Aravis' objects and errors by RAII, and the settings of a camera; only for the .cc files of this folder.
#pragma once

#include <absl/status/status.h>
#include <arv.h>

#include <memory>
#include <mutex>
#include <string>

#include "common/live_camera_config.h"

namespace kinevox {

struct Unref {
    void operator()(void* object) const {
        if (object) g_object_unref(object);
    }
};
template <typename T>
using GHandle = std::unique_ptr<T, Unref>;

// Passed as GError**; owns the error.
class GCatch {
  public:
    ~GCatch() { g_clear_error(&error_); }
    operator GError**() {
        g_clear_error(&error_);
        return &error_;
    }
    bool caught() const { return error_ != nullptr; }
    std::string message() const { return error_ && error_->message ? error_->message : "no reason given"; }

  private:
    GError* error_ = nullptr;
};

inline std::string text_of(const char* text) {
    return text ? text : "";
}

// Aravis has one device list per process and does not fully guard it: hold this while listing or opening.
std::mutex& aravis_list_mutex();

// Pixel format, region, exposure, gain, white balance, rate and trigger. InvalidArgument names the camera,
// the key, its value and the camera's reason.
absl::Status apply_settings(ArvCamera* camera, const LiveSourceConfig& config, const LiveCameraConfig& of,
                            int width, int height);

// Enables PTP if the camera supports it.
void enable_ptp(ArvCamera* camera);
// Whether its clock is synchronised by PTP now.
bool has_ptp_time(ArvCamera* camera);

}  // namespace kinevox
