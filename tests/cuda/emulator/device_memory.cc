#include "tests/cuda/emulator/device_memory.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "tests/cuda/emulator/access_checker.h"
#include "tests/cuda/emulator/settings.h"

namespace cuda_emulator {
namespace {

constexpr std::size_t kPage = 4096, kAlignment = 256;
constexpr unsigned char kGapByte = 0x5c;
#ifdef CUDA_EMULATOR_ASAN
constexpr std::size_t kGap = 0;  // AddressSanitizer has its own
#else
constexpr std::size_t kGap = 64;
#endif

}  // namespace

void* DeviceMemory::allocate(std::size_t bytes, bool device, int gpu) {
    void* memory = nullptr;
    std::size_t mapped_bytes = 0;
    if (device && settings().guarded) {
        mapped_bytes = (bytes + kGap + kPage - 1) / kPage * kPage;
        memory = mmap(nullptr, mapped_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        if (memory == MAP_FAILED) return nullptr;
    } else if (posix_memalign(&memory, kAlignment, bytes + kGap) != 0) {
        return nullptr;
    }
    auto* begin = static_cast<unsigned char*>(memory);
    std::memset(begin, settings().poison, bytes);
    std::memset(begin + bytes, kGapByte, kGap);
    allocations_[begin] = {bytes, mapped_bytes, device, gpu};
    access::allocated(memory, bytes, device, gpu);
    set_open(false, gpu);
    return memory;
}

bool DeviceMemory::release(void* memory, bool device) {
    const auto found = allocations_.find(static_cast<unsigned char*>(memory));
    if (found == allocations_.end() || found->second.device != device) return false;
    const int gpu = found->second.gpu;
    set_open(true, gpu);
    check_gaps(gpu);
    const std::size_t mapped_bytes = found->second.mapped_bytes;
    allocations_.erase(found);
    access::freed(memory);
    if (mapped_bytes > 0) {
        munmap(memory, mapped_bytes);
    } else {
        std::free(memory);
    }
    set_open(false, gpu);
    return true;
}

const std::pair<const unsigned char* const, DeviceMemory::Allocation>* DeviceMemory::allocation_at(
    const void* memory) const {
    const auto* at = static_cast<const unsigned char*>(memory);
    auto next = allocations_.upper_bound(at);
    if (next == allocations_.begin()) return nullptr;
    --next;
    return at < next->first + next->second.bytes ? &*next : nullptr;
}

DeviceMemory::Kind DeviceMemory::kind_of(const void* memory, std::size_t bytes) const {
    const auto* const found = allocation_at(memory);
    if (!found) return Kind::kHost;
    const auto& [begin, allocation] = *found;
    if (static_cast<const unsigned char*>(memory) + bytes > begin + allocation.bytes) return Kind::kBeyond;
    return allocation.device ? Kind::kDevice : Kind::kPinned;
}

int DeviceMemory::gpu_of(const void* memory) const {
    const auto* const found = allocation_at(memory);
    return found ? found->second.gpu : -1;
}

std::size_t DeviceMemory::bytes_on(int gpu) const {
    std::size_t bytes = 0;
    for (const auto& [begin, allocation] : allocations_)
        if (allocation.device && allocation.gpu == gpu) bytes += allocation.bytes;
    return bytes;
}

void DeviceMemory::set_open(bool open, int gpu) const {
    if (!settings().guarded) return;
    for (const auto& [begin, allocation] : allocations_)
        if (allocation.device && allocation.gpu == gpu)
            mprotect(const_cast<unsigned char*>(begin), allocation.mapped_bytes,
                     open ? PROT_READ | PROT_WRITE : PROT_NONE);
}

void DeviceMemory::check_gaps(int gpu) const {
    for (const auto& [begin, allocation] : allocations_) {
        if (allocation.gpu != gpu) continue;
        const unsigned char* gap = begin + allocation.bytes;
        if (std::any_of(gap, gap + kGap, [](unsigned char byte) { return byte != kGapByte; }))
            fail("a write beyond the end of an allocation of " + std::to_string(allocation.bytes) + " bytes");
    }
}

}  // namespace cuda_emulator
