// Runs a kernel's blocks one after the other. Each CUDA thread of a block has a stack of its own and yields
// at barriers and exchanges of its warp.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "tests/cuda/emulator/cuda_runtime.h"
#include "tests/cuda/emulator/fiber.h"
#include "tests/cuda/emulator/shared_memory.h"

namespace cuda_emulator {

class BlockRunner {
  public:
    BlockRunner();
    void run(const Launch& launch, const char* name, const Call& call, std::size_t call_bytes);

    // Called by the running CUDA thread.
    int barrier(Vote vote, bool value, const char* site);
    void exchange(unsigned mask, std::uint64_t value, const char* site, Lanes& out);
    int lane() { return fibers_.running().number & 31; }
    SharedMemory& shared_memory() { return shared_memory_; }
    [[noreturn]] void report(const char* what, const char* site) const;

  private:
    struct Warp {
        // Two exchanges can be under way: a thread may begin the next one before others have left the last.
        Lanes lanes[2];
        unsigned arrived[2] = {}, left[2] = {}, mask[2] = {};
        const char* site[2] = {};
        unsigned existing = 0;
    };

    static void thread_begins();
    void prepare(const Launch& launch);
    std::vector<std::uint32_t> block_order();
    void run_block(const std::vector<int>& order);

    Fibers fibers_;
    SharedMemory shared_memory_;
    std::mt19937 random_;
    const char* name_ = "";
    const Call* call_ = nullptr;
    Block block_;
    std::vector<Fiber> threads_;
    std::vector<Warp> warps_;
    int alive_ = 0, arrived_ = 0, votes_ = 0, result_ = 0;
    unsigned generation_ = 0;     // barriers passed
    bool progress_ = false;       // since the last pass over the threads
    const char* site_ = nullptr;  // of the barrier that threads wait at
};

BlockRunner& block_runner();

}  // namespace cuda_emulator
