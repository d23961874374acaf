#include "tests/cuda/emulator/block_runner.h"

#include <algorithm>
#include <numeric>
#include <string>

#include "tests/cuda/emulator/access_checker.h"
#include "tests/cuda/emulator/settings.h"

namespace cuda_emulator {

BlockRunner& block_runner() {
    static BlockRunner only;
    return only;
}

BlockRunner::BlockRunner() : fibers_(&BlockRunner::thread_begins), random_(settings().seed) {}

void BlockRunner::report(const char* what, const char* site) const {
    const auto text = [](unsigned n) { return std::to_string(n); };
    fail(std::string(what) + " in " + name_ + ", block (" + text(block_.index.x) + ", " +
         text(block_.index.y) + ", " + text(block_.index.z) + "), at " + (site ? site : "?"));
}

void BlockRunner::thread_begins() {
    BlockRunner& runner = block_runner();
    runner.fibers_.begun();
    runner.call_->run();
    runner.fibers_.running().ended = true;
    --runner.alive_;
    runner.progress_ = true;
    if (runner.arrived_ > 0) runner.report("a thread ended while others wait at a barrier", runner.site_);
    runner.fibers_.end();
}

int BlockRunner::barrier(Vote vote, bool value, const char* site) {
    if (alive_ != static_cast<int>(threads_.size())) report("a barrier after some threads ended", site);
    if (arrived_ > 0 && site != site_) report("threads wait at different barriers", site);
    site_ = site;
    votes_ += value;
    progress_ = true;
    if (++arrived_ == alive_) {
        result_ = vote == Vote::kOr ? votes_ != 0 : vote == Vote::kAnd ? votes_ == alive_ : votes_;
        arrived_ = votes_ = 0;
        ++generation_;
        access::barrier_passed();
    } else {
        const unsigned generation = generation_;
        fibers_.running().waits_at = site;
        while (generation_ == generation) fibers_.yield();
        progress_ = true;
    }
    return result_;  // the next barrier cannot be complete before this thread arrives there
}

void BlockRunner::exchange(unsigned mask, std::uint64_t value, const char* site, Lanes& out) {
    Fiber& fiber = fibers_.running();
    const unsigned bit = 1u << (fiber.number & 31), slot = fiber.exchanges++ & 1;
    Warp& warp = warps_[fiber.number / 32];
    if (!(mask & bit)) report("a thread votes that its mask excludes", site);
    mask &= warp.existing;
    if (warp.arrived[slot] && (warp.site[slot] != site || warp.mask[slot] != mask))
        report("threads of a warp are at different votes", site);
    warp.site[slot] = site;
    warp.mask[slot] = mask;
    warp.lanes[slot].value[fiber.number & 31] = value;
    warp.arrived[slot] |= bit;
    progress_ = true;
    while ((warp.arrived[slot] & mask) != mask) {
        fiber.waits_at = site;
        fibers_.yield();
    }
    progress_ = true;
    // A vote orders memory within its warp on a GPU; the access checker ignores that and is stricter.
    warp.left[slot] |= bit;
    if (warp.left[slot] == mask) warp.left[slot] = warp.arrived[slot] = 0;
    out = warp.lanes[slot];
}

void BlockRunner::run_block(const std::vector<int>& order) {
    alive_ = static_cast<int>(threads_.size());
    arrived_ = votes_ = 0;
    for (Fiber& thread : threads_) {
        thread.ended = false;
        thread.stack = -1;
        thread.exchanges = 0;
    }
    for (Warp& warp : warps_)
        for (int slot = 0; slot < 2; ++slot) warp.arrived[slot] = warp.left[slot] = 0;
    shared_memory_.begin_block();
    while (alive_ > 0) {
        progress_ = false;
        for (const int n : order)
            if (!threads_[n].ended) fibers_.enter(threads_[n]);
        if (!progress_) {
            const auto waiting = std::find_if(threads_.begin(), threads_.end(),
                                              [](const Fiber& thread) { return !thread.ended; });
            report("no thread can continue", waiting->waits_at);
        }
    }
    shared_memory_.end_block();
}

void BlockRunner::prepare(const Launch& launch) {
    const unsigned width = launch.block.x, height = launch.block.y;
    const int count = static_cast<int>(width * height * launch.block.z);
    block_.size = launch.block;
    block_.grid = launch.grid;
    threads_.resize(count);
    warps_.resize((count + 31) / 32);
    for (int n = 0; n < count; ++n) {
        threads_[n].number = n;
        threads_[n].block = &block_;
        const auto place = static_cast<unsigned>(n);
        threads_[n].index = {place % width, place / width % height, place / (width * height)};
    }
    for (std::size_t n = 0; n < warps_.size(); ++n) {
        const int lanes = std::min(32, count - 32 * static_cast<int>(n));
        warps_[n].existing = lanes == 32 ? 0xffffffffu : (1u << lanes) - 1;
    }
}

std::vector<std::uint32_t> BlockRunner::block_order() {
    std::vector<std::uint32_t> order(std::size_t{block_.grid.x} * block_.grid.y * block_.grid.z);
    std::iota(order.begin(), order.end(), 0u);
    if (settings().order == Order::kReverse) std::reverse(order.begin(), order.end());
    if (settings().order == Order::kRandom) std::shuffle(order.begin(), order.end(), random_);
    return order;
}

void BlockRunner::run(const Launch& launch, const char* name, const Call& call, std::size_t call_bytes) {
    name_ = name;
    call_ = &call;
    access::kernel_begins(name, &call, call_bytes);
    shared_memory_.begin_kernel(name, launch.shared_bytes);
    prepare(launch);
    std::vector<int> order(threads_.size());
    std::iota(order.begin(), order.end(), 0);
    if (settings().order == Order::kReverse) std::reverse(order.begin(), order.end());
    for (const std::uint32_t number : block_order()) {
        block_.index = {number % launch.grid.x, number / launch.grid.x % launch.grid.y,
                        number / (launch.grid.x * launch.grid.y)};
        access::block_begins(number);
        if (settings().order == Order::kRandom) std::shuffle(order.begin(), order.end(), random_);
        run_block(order);
    }
}

int barrier(Vote vote, bool value, const char* site) {
    return block_runner().barrier(vote, value, site);
}
void exchange(unsigned mask, std::uint64_t value, const char* site, Lanes& out) {
    block_runner().exchange(mask, value, site, out);
}
int lane() {
    return block_runner().lane();
}
void report_absent_lane(const char* site) {
    block_runner().report("a shuffle from a thread outside of the mask", site);
}
void* shared_memory(const void* key, const char* name, std::size_t bytes, std::size_t alignment) {
    return block_runner().shared_memory().variable(key, name, bytes, alignment);
}
void* dynamic_shared_memory() {
    return block_runner().shared_memory().dynamic();
}

}  // namespace cuda_emulator
