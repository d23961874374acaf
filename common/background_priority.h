// Threads that must not hold up the pipeline step back from it.
#pragma once

namespace kinevox {

// Linux: nice 10 for the calling thread and the threads it starts; elsewhere nothing. Failing is harmless.
void lower_this_threads_priority();

}  // namespace kinevox
