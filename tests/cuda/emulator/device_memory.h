// Device memory and pinned host memory, each allocation with a gap behind it that detects writes beyond the
// end.
#pragma once

#include <cstddef>
#include <map>

namespace cuda_emulator {

class DeviceMemory {
  public:
    // Null if there is no memory.
    void* allocate(std::size_t bytes, bool device);
    // False if `memory` is no such allocation.
    bool release(void* memory, bool device);
    enum class Kind { kHost, kPinned, kDevice, kBeyond };  // kBeyond: across an allocation's end
    Kind kind_of(const void* memory, std::size_t bytes) const;
    // Opens or closes device memory to this process, if settings().guarded.
    void set_open(bool open) const;
    // Ends the program if a gap was written.
    void check_gaps() const;

  private:
    struct Allocation {
        std::size_t bytes, mapped_bytes;
        bool device;
    };
    std::map<const unsigned char*, Allocation> allocations_;
};

}  // namespace cuda_emulator
