// GLib's objects and errors in C++'s way; only for the .cc files of this folder.
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

// Passed as GError**; what it caught is freed.
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

// Aravis keeps one list of devices a process and does not guard all of it; whoever lists or opens holds this.
std::mutex& aravis_list_mutex();

}  // namespace kinevox
