// Stacks of CUDA threads, and switching between them. x86-64 only.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "tests/cuda/emulator/cuda_runtime.h"

namespace cuda_emulator {

class Stack {
  public:
    Stack();
    ~Stack();
    Stack(const Stack&) = delete;
    Stack& operator=(const Stack&) = delete;
    unsigned char* memory() const { return memory_; }
    static std::size_t bytes();

  private:
    unsigned char* memory_ = nullptr;
};

// A CUDA thread of the running block.
struct Fiber : Thread {
    int number = 0;  // in the block
    void* stack_pointer = nullptr;
    int stack = -1;  // index in Fibers; -1: not begun or ended
    bool ended = false;
    const char* waits_at = nullptr;
    void* fake_stack = nullptr;  // AddressSanitizer's
};

// Runs fibers on the scheduler's thread, one at a time.
class Fibers {
  public:
    // `begin` is called on a stack of its own and must finish with end().
    explicit Fibers(void (*begin)()) : begin_(begin) {}
    void enter(Fiber& fiber);  // returns when the fiber yields or ends
    void yield();              // from the running fiber, to enter()
    void begun();              // first call of `begin`
    [[noreturn]] void end();   // last call of `begin`
    Fiber& running() { return *running_; }

  private:
    void prepare(Fiber& fiber);

    void (*begin_)();
    std::vector<std::unique_ptr<Stack>> stacks_;
    std::vector<int> free_stacks_;
    Fiber* running_ = nullptr;
    void* scheduler_ = nullptr;  // its stack pointer
    // For AddressSanitizer: the scheduler's stack.
    void* fake_stack_ = nullptr;
    const void* scheduler_stack_ = nullptr;
    std::size_t scheduler_bytes_ = 0;
};

}  // namespace cuda_emulator
