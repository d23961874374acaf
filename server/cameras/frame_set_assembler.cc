#include "server/cameras/frame_set_assembler.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

namespace kinevox {
namespace {

constexpr std::size_t kMaxPending = 64;
constexpr std::uint64_t kRestarted = 1000;  // a camera that counts on from so far away began anew

std::int64_t from_ms(double ms) {
    return std::llround(ms * 1e6);
}

}  // namespace

void FrameSetAssembler::Newest128::add(double value) {
    values.push_back(value);
    if (values.size() > 128) values.pop_front();
}

double FrameSetAssembler::Newest128::mean() const {
    return values.empty()
               ? 0
               : std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double FrameSetAssembler::Newest128::largest() const {
    double largest = 0;
    for (const double value : values) largest = std::max(largest, std::abs(value));
    return largest;
}

FrameSetAssembler::FrameSetAssembler(const FrameSetAssemblerOptions& options)
    : options_(options),
      period_ns_(from_ms(1000 / options.fps)),
      tolerance_ns_(options.tolerance_ms > 0 ? from_ms(options.tolerance_ms) : period_ns_ / 2),
      max_wait_ns_(from_ms(options.max_wait_ms)),
      lanes_(options.cameras) {}

void FrameSetAssembler::connect(std::size_t camera) {
    Lane& lane = lanes_.at(camera);
    lane.connected = true;
    lane.clock.reset();
    lane.last_number = 0;
    lane.newest_time_ns.reset();
}

void FrameSetAssembler::disconnect(std::size_t camera) {
    lanes_.at(camera).connected = false;
}

FrameSetAssembler::Pending* FrameSetAssembler::find(std::int64_t time_ns, std::size_t camera) {
    Pending* nearest = nullptr;
    for (Pending& set : pending_) {
        const std::int64_t apart = std::abs(set.time_ns - time_ns);
        if (apart > tolerance_ns_ || set.slots[camera].there) continue;
        if (!nearest || apart < std::abs(nearest->time_ns - time_ns)) nearest = &set;
    }
    return nearest;
}

void FrameSetAssembler::add(ArrivedPicture arrived) {
    Lane& lane = lanes_.at(arrived.camera);
    const bool complete = !arrived.picture.empty();
    if (arrived.number > 0) {
        if (lane.last_number > 0 && arrived.number > lane.last_number + 1 &&
            arrived.number - lane.last_number < kRestarted)
            lane.counts.lost += arrived.number - lane.last_number - 1;
        lane.last_number = arrived.number;
    }
    if (!complete) ++lane.counts.incomplete;
    if (arrived.clock == CameraClock::kUnknown) return;
    lane.counts.clock = arrived.clock;

    std::int64_t time_ns = arrived.arrival_ns;
    if (arrived.clock != CameraClock::kArrival) {
        ClockEstimate& clock = clock_of(lane, arrived.clock);
        time_ns = clock.add(arrived.timestamp_ns, arrived.arrival_ns);
        lane.counts.clock_drift_ppm = clock.drift_ppm();
        if (!clock.settled()) {
            if (complete) ++lane.counts.settling;
            return;
        }
    }
    lane.newest_time_ns = std::max(lane.newest_time_ns.value_or(time_ns), time_ns);
    // What belongs to the set that went out last, unless that one has this camera's picture: then it is the
    // next.
    if (last_time_ns_ && time_ns <= *last_time_ns_ + (lane.in_last_set ? 0 : tolerance_ns_)) {
        if (complete) ++lane.counts.late;
        return;
    }
    Pending* set = find(time_ns, arrived.camera);
    if (!set) {
        Pending opened{time_ns, arrived.arrival_ns, std::vector<Slot>(lanes_.size())};
        const auto at = std::ranges::upper_bound(pending_, time_ns, {}, &Pending::time_ns);
        set = &*pending_.insert(at, std::move(opened));
    }
    set->begin_ns = std::min(set->begin_ns, arrived.arrival_ns);
    set->slots[arrived.camera] = {
        true, time_ns, arrived.arrival_ns, arrived.clock, arrived.timestamp_ns, std::move(arrived.picture)};
}

bool FrameSetAssembler::is_ready(const Pending& set, std::int64_t now_ns) const {
    if (now_ns >= set.begin_ns + max_wait_ns_ || pending_.size() > kMaxPending) return true;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        const auto& newest_ns =
            lanes_[c].newest_time_ns;  // empty: it has only just come, its clock is being learned
        if (set.slots[c].there || !lanes_[c].connected) continue;
        if (!newest_ns) {
            if (!last_time_ns_) return false;  // all of them have, at the beginning
            continue;
        }
        // Its pictures come in order: one of a later time says that none will come for this set.
        if (*newest_ns <= set.time_ns + tolerance_ns_) return false;
    }
    return true;
}

std::optional<FrameSet> FrameSetAssembler::take(std::int64_t now_ns) {
    while (!pending_.empty() && is_ready(pending_.front(), now_ns)) {
        Pending set = std::move(pending_.front());
        pending_.pop_front();
        if (auto finished = finish(std::move(set))) return finished;
    }
    return std::nullopt;
}

// Pictures by one clock differ as their timestamps do; the estimate, which moves, only says where on the
// steady clock.
void FrameSetAssembler::compare_directly(std::vector<Slot>& slots) {
    const Slot* first = nullptr;
    for (Slot& slot : slots) {
        if (!slot.there || slot.clock != CameraClock::kPtp) continue;
        if (!first) first = &slot;
        slot.time_ns = first->time_ns + (slot.timestamp_ns - first->timestamp_ns);
    }
}

std::optional<FrameSet> FrameSetAssembler::finish(Pending set) {
    compare_directly(set.slots);
    last_time_ns_ = std::max(last_time_ns_.value_or(set.time_ns), set.time_ns);
    for (std::size_t c = 0; c < lanes_.size(); ++c) lanes_[c].in_last_set = set.slots[c].there;
    std::size_t complete = 0;
    std::int64_t first_ns = 0, last_ns = 0, first_arrival_ns = 0;
    double mean_ns = 0;  // against set.time_ns
    for (const Slot& slot : set.slots) {
        if (slot.picture.empty()) continue;
        first_ns = complete ? std::min(first_ns, slot.time_ns) : slot.time_ns;
        last_ns = complete ? std::max(last_ns, slot.time_ns) : slot.time_ns;
        first_arrival_ns = complete ? std::min(first_arrival_ns, slot.arrival_ns) : slot.arrival_ns;
        mean_ns += static_cast<double>(slot.time_ns - set.time_ns);
        ++complete;
    }
    if (complete < std::max<std::size_t>(1, std::min(options_.min_pictures, lanes_.size()))) {
        for (std::size_t c = 0; c < lanes_.size(); ++c)
            if (!set.slots[c].picture.empty()) ++lanes_[c].counts.unmatched;
        return std::nullopt;
    }
    FrameSet out;
    out.capture_time_ns = set.time_ns + std::llround(mean_ns / static_cast<double>(complete));
    if (last_capture_ns_) {
        out.capture_time_ns = std::max(out.capture_time_ns, *last_capture_ns_ + 1);
        const double periods =
            static_cast<double>(out.capture_time_ns - *last_capture_ns_) / static_cast<double>(period_ns_);
        next_sequence_ += std::max<std::uint64_t>(1, static_cast<std::uint64_t>(periods + 0.4));
    }
    last_capture_ns_ = out.capture_time_ns;
    out.sequence = next_sequence_;
    const std::int64_t middle_ns = first_ns + (last_ns - first_ns) / 2;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        Slot& slot = set.slots[c];
        Lane& lane = lanes_[c];
        out.picture_times_ns.push_back(slot.picture.empty() ? out.capture_time_ns : slot.time_ns);
        if (!slot.picture.empty()) {
            ++lane.counts.pictures;
            lane.skew_ms.add(static_cast<double>(slot.time_ns - middle_ns) * 1e-6);
            lane.lateness_ms.add(static_cast<double>(slot.arrival_ns - first_arrival_ns) * 1e-6);
        }
        out.pictures.push_back(std::move(slot.picture));
    }
    return out;
}

std::optional<std::int64_t> FrameSetAssembler::due_ns() const {
    if (pending_.empty()) return std::nullopt;
    return pending_.front().begin_ns + max_wait_ns_;
}

void FrameSetAssembler::fill(std::size_t camera, CameraLink& link) const {
    const Lane& lane = lanes_.at(camera);
    link.connected = lane.connected;
    link.clock = lane.counts.clock;
    link.pictures = lane.counts.pictures;
    link.lost = lane.counts.lost;
    link.incomplete = lane.counts.incomplete;
    link.late = lane.counts.late;
    link.unmatched = lane.counts.unmatched;
    link.settling = lane.counts.settling;
    link.clock_drift_ppm = lane.counts.clock_drift_ppm;
    link.skew_ms = lane.skew_ms.mean();
    link.skew_max_ms = lane.skew_ms.largest();
    link.lateness_ms = lane.lateness_ms.mean();
    link.lateness_max_ms = lane.lateness_ms.largest();
}

}  // namespace kinevox
