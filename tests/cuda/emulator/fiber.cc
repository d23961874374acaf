#include "tests/cuda/emulator/fiber.h"

#include <sys/mman.h>

#include <cstdint>

#include "tests/cuda/emulator/access_checker.h"
#include "tests/cuda/emulator/settings.h"

#ifdef CUDA_EMULATOR_ASAN
#include <sanitizer/common_interface_defs.h>
#else
static void __sanitizer_start_switch_fiber(void**, const void*, std::size_t) {}
static void __sanitizer_finish_switch_fiber(void*, const void**, std::size_t*) {}
#endif

// Saves the callee's registers and the stack pointer, and continues at another stack's.
extern "C" void cuda_emulator_switch(void** from, void* to);
asm(R"(
.text
.type cuda_emulator_switch, @function
cuda_emulator_switch:
    pushq %rbp
    pushq %rbx
    pushq %r12
    pushq %r13
    pushq %r14
    pushq %r15
    movq %rsp, (%rdi)
    movq %rsi, %rsp
    popq %r15
    popq %r14
    popq %r13
    popq %r12
    popq %rbx
    popq %rbp
    ret
.size cuda_emulator_switch, .-cuda_emulator_switch
)");

namespace cuda_emulator {

__thread Thread* current = nullptr;

std::size_t Stack::bytes() {
#ifdef CUDA_EMULATOR_ASAN
    return 256 << 10;
#else
    return 64 << 10;
#endif
}

Stack::Stack() {
    void* memory = mmap(nullptr, bytes(), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) fail("no memory for the stack of a CUDA thread");
    mprotect(memory, 4096, PROT_NONE);  // an overflow ends the program
    memory_ = static_cast<unsigned char*>(memory);
}

Stack::~Stack() {
    munmap(memory_, bytes());
}

void Fibers::prepare(Fiber& fiber) {
    if (free_stacks_.empty()) {
        free_stacks_.push_back(static_cast<int>(stacks_.size()));
        stacks_.push_back(std::make_unique<Stack>());
    }
    fiber.stack = free_stacks_.back();
    free_stacks_.pop_back();
    auto* top = reinterpret_cast<std::uint64_t*>(stacks_[fiber.stack]->memory() + Stack::bytes());
    *--top = 0;  // aligned as after a call
    *--top = reinterpret_cast<std::uint64_t>(begin_);
    for (int n = 0; n < 6; ++n) *--top = 0;
    fiber.stack_pointer = top;
}

void Fibers::enter(Fiber& fiber) {
    if (fiber.stack < 0) prepare(fiber);
    const unsigned char* stack = stacks_[fiber.stack]->memory();
    running_ = &fiber;
    current = &fiber;
    access::thread_runs(fiber.number, stack, Stack::bytes(), &fiber, sizeof fiber);
    __sanitizer_start_switch_fiber(&fake_stack_, stack, Stack::bytes());
    cuda_emulator_switch(&scheduler_, fiber.stack_pointer);
    __sanitizer_finish_switch_fiber(fake_stack_, nullptr, nullptr);
    current = nullptr;
    access::host_runs();
    if (fiber.ended) {
        free_stacks_.push_back(fiber.stack);
        fiber.stack = -1;
    }
}

void Fibers::yield() {
    Fiber& fiber = *running_;
    __sanitizer_start_switch_fiber(&fiber.fake_stack, scheduler_stack_, scheduler_bytes_);
    cuda_emulator_switch(&fiber.stack_pointer, scheduler_);
    __sanitizer_finish_switch_fiber(fiber.fake_stack, &scheduler_stack_, &scheduler_bytes_);
}

void Fibers::begun() {
    __sanitizer_finish_switch_fiber(nullptr, &scheduler_stack_, &scheduler_bytes_);
}

void Fibers::end() {
    __sanitizer_start_switch_fiber(nullptr, scheduler_stack_, scheduler_bytes_);
    void* discarded;
    cuda_emulator_switch(&discarded, scheduler_);
    __builtin_unreachable();
}

}  // namespace cuda_emulator
