// The form that the benchmarks time, and the times of single iterations. deploy/gpu-proof runs both forms.
#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels::bench {

// That of KINEVOX_BENCH_DEVICE, cuda:1 for instance, else the CPU.
inline Device device() {
    const char* const wanted = std::getenv("KINEVOX_BENCH_DEVICE");
    const auto device = device_of_name(wanted ? wanted : "cpu");
    if (!device) throw std::invalid_argument(std::string("KINEVOX_BENCH_DEVICE: use ") + kDeviceNames);
    return *device;
}

// Adds the counters NAME_median_us and NAME_p99_us of its samples to a benchmark.
class Samples {
  public:
    explicit Samples(std::string name = "") : prefix_(name.empty() ? "" : name + "_") {}
    void add_ms(double ms) { us_.push_back(1e3 * ms); }
    template <class F>
    void time(F work) {
        const auto begin = std::chrono::steady_clock::now();
        work();
        add_ms(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count());
    }
    void report(benchmark::State& state) {
        if (us_.empty()) return;
        std::sort(us_.begin(), us_.end());
        state.counters[prefix_ + "median_us"] = us_[us_.size() / 2];
        state.counters[prefix_ + "p99_us"] = us_[us_.size() * 99 / 100];
    }

  private:
    std::string prefix_;
    std::vector<double> us_;
};

}  // namespace kinevox::kernels::bench
