// RAII for GLib's objects and errors; only for the .cc files of this folder.
#pragma once

#include <arv.h>

#include <memory>
#include <mutex>
#include <string>

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

}  // namespace kinevox
