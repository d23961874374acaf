// What the environment asks of the emulator. Each setting keeps a correct program's results.
#pragma once

#include <cstdint>
#include <string>

namespace cuda_emulator {

enum class Order { kForward, kReverse, kRandom };

struct Settings {
    Order order =
        Order::kForward;  // KINEVOX_EMULATOR_ORDER=forward, reverse or random[:SEED]: blocks and threads
    std::uint32_t seed = 1;
    unsigned char poison = 0xa5;  // KINEVOX_EMULATOR_POISON=N: content of fresh device and shared memory
    bool deferred =
        false;  // KINEVOX_EMULATOR_DEFERRED=1: a stream's work is done when the host waits for it, not before
    bool guarded = false;  // KINEVOX_EMULATOR_GUARDED=1: the host's accesses to device memory end the program
    int devices = 2;       // KINEVOX_EMULATOR_DEVICES=N: number of GPUs
    bool profile = false;  // KINEVOX_EMULATOR_PROFILE=1: launches, blocks and time of each kernel, at exit
};

const Settings& settings();

// Prints "CUDA emulator: WHAT" and ends the program.
[[noreturn]] void fail(const std::string& what);

}  // namespace cuda_emulator
