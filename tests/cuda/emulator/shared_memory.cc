#include "tests/cuda/emulator/shared_memory.h"

#include <algorithm>
#include <cstring>

#include "tests/cuda/emulator/access_checker.h"
#include "tests/cuda/emulator/settings.h"

#ifdef CUDA_EMULATOR_ASAN
#include <sanitizer/asan_interface.h>
#else
#define ASAN_POISON_MEMORY_REGION(memory, bytes) static_cast<void>(memory)
#define ASAN_UNPOISON_MEMORY_REGION(memory, bytes) static_cast<void>(memory)
#endif

namespace cuda_emulator {
namespace {

constexpr std::size_t kMaxStaticBytes = 48 << 10, kMaxDynamicBytes = 227 << 10, kGap = 64;
constexpr unsigned char kGapByte = 0x5c;

}  // namespace

SharedMemory::SharedMemory() : memory_(2 * kMaxStaticBytes + kMaxDynamicBytes) {
    ASAN_POISON_MEMORY_REGION(memory_.data(), memory_.size());
}

void SharedMemory::begin_kernel(const char* kernel, std::size_t dynamic_bytes) {
    ASAN_POISON_MEMORY_REGION(memory_.data(), memory_.size());
    kernel_ = kernel;
    variables_.clear();
    dynamic_bytes_ = dynamic_bytes;
    if (dynamic_bytes > kMaxDynamicBytes)
        fail(std::string(kernel) + " asks for more shared memory than a block can have");
}

void SharedMemory::reset(const Variable& variable) {
    unsigned char* memory = memory_.data() + variable.begin;
    unsigned char* gap = memory + variable.bytes;
    const std::size_t gap_bytes = variable.end - variable.begin - variable.bytes;
    ASAN_UNPOISON_MEMORY_REGION(memory, variable.end - variable.begin);
    std::memset(memory, settings().poison, variable.bytes);
    std::memset(gap, kGapByte, gap_bytes);
    ASAN_POISON_MEMORY_REGION(gap, gap_bytes);
    access::shared_memory_begins(memory, variable.bytes);
}

void SharedMemory::begin_block() {
    for (const Variable& variable : variables_) reset(variable);
}

void SharedMemory::end_block() const {
#ifndef CUDA_EMULATOR_ASAN  // it reports the access itself
    for (const Variable& variable : variables_) {
        const auto gap = memory_.begin() + static_cast<std::ptrdiff_t>(variable.begin + variable.bytes);
        const auto end = memory_.begin() + static_cast<std::ptrdiff_t>(variable.end);
        if (std::any_of(gap, end, [](unsigned char byte) { return byte != kGapByte; }))
            fail(std::string(kernel_) + " writes beyond its shared variable " + variable.name);
    }
#endif
}

void* SharedMemory::variable(const void* key, const char* name, std::size_t bytes, std::size_t alignment) {
    for (const Variable& variable : variables_)
        if (variable.key == key) return memory_.data() + variable.begin;
    std::size_t begin = variables_.empty() ? 0 : variables_.back().end, used = bytes;
    const auto base = reinterpret_cast<std::size_t>(memory_.data());
    begin = (base + begin + alignment - 1) / alignment * alignment - base;
    for (const Variable& variable : variables_) used += variable.bytes;
    if (key != nullptr && used > kMaxStaticBytes + dynamic_bytes_)
        fail(std::string(kernel_) + " has more than 48 KiB of shared variables");
    // A multiple of 8: AddressSanitizer's granularity.
    variables_.push_back({key, name, begin, bytes, (begin + bytes + kGap + 7) / 8 * 8});
    reset(variables_.back());
    return memory_.data() + begin;
}

void* SharedMemory::dynamic() {
    return variable(nullptr, "(dynamic)", dynamic_bytes_, 128);
}

}  // namespace cuda_emulator
