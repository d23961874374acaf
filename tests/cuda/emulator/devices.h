// The emulated GPUs, all alike. Each thread has a current one, at first cuda:0. Streams, graphs and memory
// belong to the GPU that is current when they are made; their use while another one is current ends the
// program, also where CUDA would allow it.
#pragma once

#include <vector>

namespace cuda_emulator {

// The calling thread's.
int current_device();

// GPUs on which CUDA would have a context since the last call, in ascending order.
std::vector<int> take_devices_with_context();

// From now on each call for this GPU fails, as after an invalid access of a kernel.
void break_device(int device);
void repair_devices();

// Ends the program unless `device`, which `what` belongs to, is the calling thread's.
void require_current(int device, const char* what);

}  // namespace cuda_emulator
