// Preloaded under ThreadSanitizer. Debian's gRPC and Abseil are not instrumented, and Abseil's mutex consists
// of atomics that the sanitizer does not see: data passed between threads through gRPC looks like a race. The
// functions here report each use of these mutexes to the sanitizer, and those below Qt's signals.
#include <absl/base/options.h>
#include <absl/synchronization/mutex.h>
#include <absl/time/time.h>
#include <dlfcn.h>

#include <string>

extern "C" {
// Absent in programs without the sanitizer, which are preloaded with this library, too.
__attribute__((weak)) void __tsan_acquire(void* address);
__attribute__((weak)) void __tsan_release(void* address);
}

namespace {

#define AS_TEXT(name) #name
#define TEXT_OF(name) AS_TEXT(name)

// The library's own function; `name` as mangled after Abseil's namespace.
template <class F>
F real(const char* name) {
    const std::string space = TEXT_OF(ABSL_OPTION_INLINE_NAMESPACE_NAME);
    return reinterpret_cast<F>(
        dlsym(RTLD_NEXT, ("_ZN4absl" + std::to_string(space.size()) + space + name).c_str()));
}

void acquire(void* address) {
    if (__tsan_acquire) __tsan_acquire(address);
}
void release(void* address) {
    if (__tsan_release) __tsan_release(address);
}

}  // namespace

void absl::Mutex::Lock() {
    static const auto lock = real<void (*)(Mutex*)>("5Mutex4LockEv");
    lock(this);
    acquire(this);
}

void absl::Mutex::Unlock() {
    static const auto unlock = real<void (*)(Mutex*)>("5Mutex6UnlockEv");
    release(this);
    unlock(this);
}

bool absl::Mutex::TryLock() {
    static const auto try_lock = real<bool (*)(Mutex*)>("5Mutex7TryLockEv");
    const bool locked = try_lock(this);
    if (locked) acquire(this);
    return locked;
}

void absl::CondVar::Wait(Mutex* mutex) {
    static const auto wait = real<void (*)(CondVar*, Mutex*)>("7CondVar4WaitEPNS0_5MutexE");
    release(mutex);
    wait(this, mutex);
    acquire(mutex);
}

bool absl::CondVar::WaitWithTimeout(Mutex* mutex, Duration timeout) {
    static const auto wait =
        real<bool (*)(CondVar*, Mutex*, Duration)>("7CondVar15WaitWithTimeoutEPNS0_5MutexENS0_8DurationE");
    release(mutex);
    const bool timed_out = wait(this, mutex, timeout);
    acquire(mutex);
    return timed_out;
}

bool absl::CondVar::WaitWithDeadline(Mutex* mutex, Time deadline) {
    static const auto wait =
        real<bool (*)(CondVar*, Mutex*, Time)>("7CondVar16WaitWithDeadlineEPNS0_5MutexENS0_4TimeE");
    release(mutex);
    const bool timed_out = wait(this, mutex, deadline);
    acquire(mutex);
    return timed_out;
}

// Qt's signals between threads, and the events that deliver them. By their mangled names, for programs
// without Qt. Everything before a signal is ordered before every later event: coarser than one lock per
// queue.
namespace {

char signals;

template <class F>
F qt(const char* name) {
    return reinterpret_cast<F>(dlsym(RTLD_NEXT, name));
}

}  // namespace

#define QT_ACTIVATE "_ZN11QMetaObject8activateEP7QObjectPKS_iPPv"
extern "C" void qt_activate(void* sender, const void* type, int signal, void** values) __asm__(QT_ACTIVATE);
extern "C" void qt_activate(void* sender, const void* type, int signal, void** values) {
    static const auto activate = qt<void (*)(void*, const void*, int, void**)>(QT_ACTIVATE);
    release(&signals);
    activate(sender, type, signal, values);
}

#define QT_EVENT(function, mangled)                                         \
    extern "C" bool function(void* receiver, void* event) __asm__(mangled); \
    extern "C" bool function(void* receiver, void* event) {                 \
        static const auto take = qt<bool (*)(void*, void*)>(mangled);       \
        acquire(&signals);                                                  \
        return take(receiver, event);                                       \
    }
QT_EVENT(qt_object_event, "_ZN7QObject5eventEP6QEvent")
QT_EVENT(qt_widget_event, "_ZN7QWidget5eventEP6QEvent")
QT_EVENT(qt_main_window_event, "_ZN11QMainWindow5eventEP6QEvent")
