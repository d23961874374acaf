// The shared memory of the running block. Gaps between variables detect accesses beyond them.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace cuda_emulator {

class SharedMemory {
  public:
    SharedMemory();
    // Forgets the variables of the kernel before.
    void begin_kernel(const char* kernel, std::size_t dynamic_bytes);
    // Fills all with the poison.
    void begin_block();
    // Ends the program if a gap was written.
    void end_block() const;
    void* variable(const void* key, const char* name, std::size_t bytes, std::size_t alignment);
    void* dynamic();

  private:
    struct Variable {
        const void* key;
        const char* name;
        std::size_t begin, bytes, end;  // end: of the gap behind it
    };
    void reset(const Variable& variable);

    const char* kernel_ = "";
    std::vector<unsigned char> memory_;
    std::vector<Variable> variables_;
    std::size_t dynamic_bytes_ = 0;
};

}  // namespace cuda_emulator
