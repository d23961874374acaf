// Threads that must not hold up the pipeline step back from it.
#pragma once

#include <functional>

namespace kinevox {

// Linux: nice 10 for the calling thread and the threads it starts; elsewhere nothing. Failing is harmless.
void lower_this_threads_priority();

// Linux: makes the calling thread and the threads it starts `levels` nicer than it is, which leaves it a
// share of busy processors; elsewhere nothing. Failing is harmless.
void lower_this_threads_priority_by(int levels);

// Runs `work` to its end; on Linux the threads that it starts are `levels` nicer than the caller
// (setpriority(2): each is some 0.8 of the processor time, where there is too little), yet never nicer than
// an ordinary program. Failing is harmless.
void with_nicer_threads(int levels, const std::function<void()>& work);

}  // namespace kinevox
