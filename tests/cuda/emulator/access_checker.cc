#include "tests/cuda/emulator/access_checker.h"

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "tests/cuda/emulator/cuda_runtime.h"

extern "C" {
extern char __executable_start, _end;  // of the program: its constants
}

namespace cuda_emulator::access {
namespace {

constexpr std::uintptr_t kPage = 4096;

struct Access {
    std::uint32_t launch = 0, thread = 0;  // thread: block * 1024 + number
    std::uint32_t epoch : 31, atomic : 1;  // epoch: barriers passed by the block
    Access() : epoch(0), atomic(0) {}
};
struct Byte {
    Access write, read, other_read;  // reads by two threads: a later write may be by one of them
    bool initialised = false;
};
struct Page {
    Byte bytes[kPage];
};
struct Range {
    std::uintptr_t begin = 0, end = 0;
    bool contains(std::uintptr_t at) const { return at >= begin && at < end; }
};
Range range_of(const void* memory, std::size_t bytes) {
    const auto begin = reinterpret_cast<std::uintptr_t>(memory);
    return {begin, begin + bytes};
}

std::unordered_map<std::uintptr_t, std::unique_ptr<Page>> pages;
std::uintptr_t cached_number = 0;
Page* cached_page = nullptr;
struct Allocation {
    std::size_t bytes;
    bool device;
    int gpu;
};
std::map<std::uintptr_t, Allocation> allocations;

const char* kernel = "";
int gpu_of_kernel = 0;
Access now;
thread_local bool in_kernel = false;  // other threads of the host may run meanwhile
Range stack, state, arguments;
std::vector<Range> shared_variables;  // of the running block
std::set<std::pair<std::uintptr_t, std::string>> reported;

Byte& byte_at(std::uintptr_t at) {
    const std::uintptr_t number = at / kPage;
    if (number != cached_number || !cached_page) {
        std::unique_ptr<Page>& page = pages[number];
        if (!page) page = std::make_unique<Page>();
        cached_number = number;
        cached_page = page.get();
    }
    return cached_page->bytes[at % kPage];
}

std::string source_line(const void* pc) {
    char command[256], line[512] = "?";
    const auto offset =
        reinterpret_cast<std::uintptr_t>(pc) - 1 - reinterpret_cast<std::uintptr_t>(&__executable_start);
    std::snprintf(command, sizeof command, "addr2line -s -e /proc/%d/exe %#lx", static_cast<int>(getpid()),
                  offset);
    if (FILE* pipe = popen(command, "r")) {
        if (std::fgets(line, sizeof line, pipe)) line[std::char_traits<char>::length(line) - 1] = 0;
        pclose(pipe);
    }
    return line;
}

bool is_shared(std::uintptr_t at) {
    for (const Range& variable : shared_variables)
        if (variable.contains(at)) return true;
    return false;
}

void report(const char* what, std::uintptr_t at, const void* pc, const Access* other = nullptr) {
    if (!reported.insert({reinterpret_cast<std::uintptr_t>(pc), what}).second) return;
    std::string memory = is_shared(at) ? "shared memory" : "no known memory";
    auto found = allocations.upper_bound(at);
    if (found != allocations.begin() && at < (--found)->first + found->second.bytes)
        memory = "byte " + std::to_string(at - found->first) + " of " + std::to_string(found->second.bytes);
    std::fprintf(stderr, "CUDA emulator: %s in %s, block %u thread %u, %s", what, kernel, now.thread >> 10,
                 now.thread & 1023, memory.c_str());
    if (other) std::fprintf(stderr, ", with block %u thread %u", other->thread >> 10, other->thread & 1023);
    std::fprintf(stderr, ", at %s\n", source_line(pc).c_str());
}

bool unordered(const Access& before, bool atomic) {
    if (before.launch != now.launch || before.thread == now.thread || (before.atomic && atomic)) return false;
    return before.thread >> 10 != now.thread >> 10 || before.epoch == now.epoch;
}

enum class Where { kThread, kShared, kProgram, kPinned, kDevice, kOtherDevice, kUnknown };

Where where_is(std::uintptr_t at, std::size_t bytes, bool& beyond) {
    if (stack.contains(at) || arguments.contains(at) || state.contains(at) ||
        at == reinterpret_cast<std::uintptr_t>(&current))
        return Where::kThread;
    if (is_shared(at)) {
        beyond = !is_shared(at + bytes - 1);
        return Where::kShared;
    }
    if (range_of(&__executable_start, &_end - &__executable_start).contains(at)) return Where::kProgram;
    auto found = allocations.upper_bound(at);
    if (found == allocations.begin() || at >= (--found)->first + found->second.bytes) return Where::kUnknown;
    beyond = at + bytes > found->first + found->second.bytes;
    if (!found->second.device) return Where::kPinned;
    return found->second.gpu == gpu_of_kernel ? Where::kDevice : Where::kOtherDevice;
}

void check_read(Byte& byte, const Access& access, std::uintptr_t at, const void* pc) {
    if (!byte.initialised) report("a read of uninitialised memory", at, pc);
    if (unordered(byte.write, access.atomic)) report("a race (read after write)", at, pc, &byte.write);
    if (byte.read.thread != access.thread || byte.read.launch != access.launch) {
        const bool other_block = byte.read.thread >> 10 != access.thread >> 10;
        if (byte.read.launch == access.launch && (other_block || byte.other_read.launch != access.launch))
            byte.other_read = byte.read;
    }
    byte.read = access;
}

void check_write(Byte& byte, const Access& access, std::uintptr_t at, const void* pc) {
    if (unordered(byte.write, access.atomic)) report("a race (write after write)", at, pc, &byte.write);
    if (unordered(byte.read, access.atomic)) report("a race (write after read)", at, pc, &byte.read);
    if (unordered(byte.other_read, access.atomic))
        report("a race (write after read)", at, pc, &byte.other_read);
    byte.write = access;
    byte.initialised = true;
}

struct Kind {
    bool read, write, atomic;
};

void check(const volatile void* memory, std::size_t bytes, Kind kind, const void* pc) {
    if (!in_kernel) return;
    const auto at = reinterpret_cast<std::uintptr_t>(memory);
    bool beyond = false;
    const Where where = where_is(at, bytes, beyond);
    if (where == Where::kThread || where == Where::kPinned || where == Where::kProgram) return;
    if (where == Where::kUnknown) return report("an access to host memory or outside of allocations", at, pc);
    if (where == Where::kOtherDevice) return report("an access to another GPU's memory", at, pc);
    if (beyond) return report("an access beyond the end of an allocation", at, pc);
    Access access = now;
    access.atomic = kind.atomic;
    for (std::size_t n = 0; n < bytes; ++n) {
        Byte& byte = byte_at(at + n);
        if (kind.read) check_read(byte, access, at + n, pc);
        if (kind.write) check_write(byte, access, at + n, pc);
    }
}

}  // namespace

void allocated(const void* memory, std::size_t bytes, bool device, int gpu) {
    const auto at = reinterpret_cast<std::uintptr_t>(memory);
    allocations[at] = {bytes, device, gpu};
    for (std::size_t n = 0; device && n < bytes; ++n) byte_at(at + n) = {};
}
void freed(const void* memory) {
    allocations.erase(reinterpret_cast<std::uintptr_t>(memory));
}
void written(const void* memory, std::size_t bytes) {
    const auto at = reinterpret_cast<std::uintptr_t>(memory);
    for (std::size_t n = 0; n < bytes; ++n) byte_at(at + n).initialised = true;
}
void gpu_runs(int gpu) {
    gpu_of_kernel = gpu;
}
void kernel_begins(const char* name, const void* call, std::size_t bytes) {
    kernel = name;
    ++now.launch;
    arguments = range_of(call, bytes);
}
void block_begins(std::uint64_t block) {
    now.thread = static_cast<std::uint32_t>(block << 10);
    now.epoch = 0;
    shared_variables.clear();
}
void shared_memory_begins(const void* memory, std::size_t bytes) {
    const Range range = range_of(memory, bytes);
    for (std::uintptr_t at = range.begin; at < range.end; ++at) byte_at(at) = {};
    shared_variables.push_back(range);
}
void thread_runs(int number, const void* memory, std::size_t bytes, const void* own, std::size_t own_bytes) {
    in_kernel = true;
    now.thread = (now.thread & ~1023u) | static_cast<std::uint32_t>(number);
    stack = range_of(memory, bytes);
    state = range_of(own, own_bytes);
}
void host_runs() {
    in_kernel = false;
}
void barrier_passed() {
    now.epoch = now.epoch + 1;
}

}  // namespace cuda_emulator::access

// What code compiled with -fsanitize=thread calls.
#define CHECK(memory, bytes, ...)                                                         \
    cuda_emulator::access::check(memory, bytes, cuda_emulator::access::Kind{__VA_ARGS__}, \
                                 __builtin_return_address(0))
extern "C" {
void __tsan_init() {}
void __tsan_func_entry(void*) {}
void __tsan_func_exit() {}
void __tsan_vptr_update(void**, void*) {}
void __tsan_vptr_read(void**) {}
void __tsan_read_range(void* p, unsigned long n) {
    CHECK(p, n, true, false, false);
}
void __tsan_write_range(void* p, unsigned long n) {
    CHECK(p, n, false, true, false);
}
#define PLAIN(size)                              \
    void __tsan_read##size(void* p) {            \
        CHECK(p, size, true, false, false);      \
    }                                            \
    void __tsan_write##size(void* p) {           \
        CHECK(p, size, false, true, false);      \
    }                                            \
    void __tsan_unaligned_read##size(void* p) {  \
        CHECK(p, size, true, false, false);      \
    }                                            \
    void __tsan_unaligned_write##size(void* p) { \
        CHECK(p, size, false, true, false);      \
    }                                            \
    void __tsan_volatile_read##size(void* p) {   \
        CHECK(p, size, true, false, true);       \
    }                                            \
    void __tsan_volatile_write##size(void* p) {  \
        CHECK(p, size, false, true, true);       \
    }
PLAIN(1)
PLAIN(2)
PLAIN(4)
PLAIN(8)
PLAIN(16)
#define ATOMIC_UPDATE(bits, type, name)                                    \
    type __tsan_atomic##bits##_##name(volatile type* p, type value, int) { \
        CHECK(p, bits / 8, true, true, true);                              \
        return __atomic_##name##_n_(p, value);                             \
    }
#define __atomic_fetch_add_n_(p, v) __atomic_fetch_add(p, v, __ATOMIC_SEQ_CST)
#define __atomic_fetch_sub_n_(p, v) __atomic_fetch_sub(p, v, __ATOMIC_SEQ_CST)
#define __atomic_fetch_or_n_(p, v) __atomic_fetch_or(p, v, __ATOMIC_SEQ_CST)
#define __atomic_fetch_and_n_(p, v) __atomic_fetch_and(p, v, __ATOMIC_SEQ_CST)
#define __atomic_exchange_n_(p, v) __atomic_exchange_n(p, v, __ATOMIC_SEQ_CST)
#define COMPARE_EXCHANGE(bits, type, name, weak)                                                            \
    int __tsan_atomic##bits##_compare_exchange_##name(volatile type* p, type* expected, type v, int, int) { \
        CHECK(p, bits / 8, true, true, true);                                                               \
        return __atomic_compare_exchange_n(p, expected, v, weak, __ATOMIC_SEQ_CST, __ATOMIC_SEQ_CST);       \
    }
#define ATOMIC(bits, type)                                                   \
    type __tsan_atomic##bits##_load(const volatile type* p, int) {           \
        CHECK(p, bits / 8, true, false, true);                               \
        return __atomic_load_n(p, __ATOMIC_SEQ_CST);                         \
    }                                                                        \
    void __tsan_atomic##bits##_store(volatile type* p, type value, int) {    \
        CHECK(p, bits / 8, false, true, true);                               \
        __atomic_store_n(p, value, __ATOMIC_SEQ_CST);                        \
    }                                                                        \
    ATOMIC_UPDATE(bits, type, fetch_add)                                     \
    ATOMIC_UPDATE(bits, type, fetch_sub)                                     \
    ATOMIC_UPDATE(bits, type, fetch_or)                                      \
    ATOMIC_UPDATE(bits, type, fetch_and)                                     \
    type __tsan_atomic##bits##_exchange(volatile type* p, type value, int) { \
        CHECK(p, bits / 8, true, true, true);                                \
        return __atomic_exchange_n(p, value, __ATOMIC_SEQ_CST);              \
    }                                                                        \
    COMPARE_EXCHANGE(bits, type, strong, false)                              \
    COMPARE_EXCHANGE(bits, type, weak, true)
ATOMIC(8, unsigned char)
ATOMIC(32, unsigned)
ATOMIC(64, unsigned long)
}
