// Device memory and pinned host memory, each allocation with a gap behind it that detects writes beyond the
// end. Both belong to a GPU.
#pragma once

#include <cstddef>
#include <map>
#include <utility>

namespace cuda_emulator {

class DeviceMemory {
  public:
    // Null if there is no memory. `device`: in device memory, `gpu`: of this GPU.
    void* allocate(std::size_t bytes, bool device, int gpu);
    // False if `memory` is no such allocation.
    bool release(void* memory, bool device);
    enum class Kind { kHost, kPinned, kDevice, kBeyond };  // kBeyond: across an allocation's end
    Kind kind_of(const void* memory, std::size_t bytes) const;
    std::size_t bytes_on(int gpu) const;  // allocated device memory
    // Of the allocation that holds `memory`; -1: the host's own memory.
    int gpu_of(const void* memory) const;
    // Opens or closes this GPU's device memory to this process, if settings().guarded.
    void set_open(bool open, int gpu) const;
    // Ends the program if a gap of this GPU's was written.
    void check_gaps(int gpu) const;

  private:
    struct Allocation {
        std::size_t bytes, mapped_bytes;
        bool device;
        int gpu;
    };
    const std::pair<const unsigned char* const, Allocation>* allocation_at(const void* memory) const;

    std::map<const unsigned char*, Allocation> allocations_;
};

}  // namespace cuda_emulator
