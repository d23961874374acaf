#include "server/cameras/frame_set_assembler.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <vector>

namespace kinevox {
namespace {

constexpr double kWindow_s = 1;
constexpr std::size_t kMaxWindows = 60;
constexpr double kMinSpan_s = 10;      // over less time the drift is hidden by the delays
constexpr double kMaxDrift = 500e-6;   // quartz oscillators are better
constexpr double kJump_s = 1;          // longer than any network delay: the clock was set
constexpr double kJumpAhead_s = 0.02;  // an image cannot arrive before its capture

constexpr std::size_t kMaxPending = 64;
constexpr std::uint64_t kMinRestartGap = 1000;  // a gap this large means that the camera restarted its count

std::int64_t from_ms(double ms) {
    return std::llround(ms * 1e6);
}

}  // namespace

std::int64_t ClockEstimate::add(std::int64_t timestamp_ns, std::int64_t arrival_ns) {
    for (;;) {
        if (samples_ == 0) {
            timestamp_0_ns_ = timestamp_ns;
            arrival_0_ns_ = arrival_ns;
        }
        const double timestamp_s = static_cast<double>(timestamp_ns - timestamp_0_ns_) * 1e-9;
        const double arrival_s = static_cast<double>(arrival_ns - arrival_0_ns_) * 1e-9;
        const Point point{timestamp_s, arrival_s - timestamp_s};
        if (samples_ > 0) {
            const double delay_s = point.offset_s - offset_at(timestamp_s);
            const bool warming_up = samples_ < kSettled;
            if (std::abs(delay_s) > kJump_s ||
                (!warming_up && delay_s < -kJumpAhead_s - kMaxDrift * kWindow_s)) {
                reset();
                continue;
            }
        }
        if (samples_ == 0 || point.offset_s < lowest_.offset_s) lowest_ = point;
        ++samples_;
        last_timestamp_ns_ = timestamp_ns;
        if (timestamp_s - window_begin_s_ >= kWindow_s) {
            close_window();
            window_begin_s_ = timestamp_s;
            lowest_ = point;
        }
        const double taken_s = timestamp_s + std::min(offset_at(timestamp_s), point.offset_s);
        return arrival_0_ns_ + std::llround(taken_s * 1e9);
    }
}

// The edge of the points' lower hull at their mean time: of all lines below the points the closest on
// average.
void ClockEstimate::close_window() {
    windows_.push_back(lowest_);
    if (windows_.size() > kMaxWindows) windows_.pop_front();
    if (windows_.back().timestamp_s - windows_.front().timestamp_s < kMinSpan_s) return;
    std::vector<Point> hull;
    double mean_s = 0;
    for (const Point& p : windows_) {
        mean_s += p.timestamp_s / static_cast<double>(windows_.size());
        while (hull.size() >= 2) {
            const Point &a = hull[hull.size() - 2], &b = hull.back();
            const double cross = (b.timestamp_s - a.timestamp_s) * (p.offset_s - a.offset_s) -
                                 (b.offset_s - a.offset_s) * (p.timestamp_s - a.timestamp_s);
            if (cross > 0) break;
            hull.pop_back();
        }
        hull.push_back(p);
    }
    std::size_t right = 1;
    while (right + 1 < hull.size() && hull[right].timestamp_s < mean_s) ++right;
    const Point &a = hull[right - 1], &b = hull[right];
    slope_ = std::clamp((b.offset_s - a.offset_s) / (b.timestamp_s - a.timestamp_s), -kMaxDrift, kMaxDrift);
    anchor_ = a;
    fitted_ = true;
    drift_ = -slope_;  // the offset of a fast clock decreases
}

double ClockEstimate::offset_at(double timestamp_s) const {
    if (fitted_) return anchor_.offset_s + slope_ * (timestamp_s - anchor_.timestamp_s);
    // The latest three windows: drift is negligible over this time.
    double lowest = lowest_.offset_s;
    for (std::size_t n = 0; n < std::min<std::size_t>(2, windows_.size()); ++n)
        lowest = std::min(lowest, windows_[windows_.size() - 1 - n].offset_s);
    return lowest;
}

void FrameSetAssembler::Latest128::add(double value) {
    values.push_back(value);
    if (values.size() > 128) values.pop_front();
}

double FrameSetAssembler::Latest128::mean() const {
    return values.empty()
               ? 0
               : std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double FrameSetAssembler::Latest128::max_abs() const {
    double largest = 0;
    for (const double value : values) largest = std::max(largest, std::abs(value));
    return largest;
}

FrameSetAssembler::FrameSetAssembler(const FrameSetAssemblerOptions& options)
    : options_(options),
      period_ns_(from_ms(1000 / options.fps)),
      tolerance_ns_(options.match_tolerance_ms > 0 ? from_ms(options.match_tolerance_ms) : period_ns_ / 2),
      max_wait_ns_(from_ms(options.max_wait_ms)),
      lanes_(options.camera_count) {}

void FrameSetAssembler::connect(std::size_t camera) {
    Lane& lane = lanes_.at(camera);
    lane.connected = true;
    lane.clock.reset();
    lane.last_number = 0;
    lane.latest_time_ns.reset();
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

void FrameSetAssembler::add(ArrivedImage arrived) {
    Lane& lane = lanes_.at(arrived.camera);
    const bool complete = !arrived.image.empty();
    if (arrived.number > 0) {
        if (lane.last_number > 0 && arrived.number > lane.last_number + 1 &&
            arrived.number - lane.last_number < kMinRestartGap)
            lane.counts.lost_image_count += arrived.number - lane.last_number - 1;
        lane.last_number = arrived.number;
    }
    if (!complete) ++lane.counts.incomplete_image_count;
    if (arrived.clock == TimestampSource::kUnknown) return;
    lane.counts.timestamp_source = arrived.clock;

    std::int64_t time_ns = arrived.arrival_ns;
    if (arrived.clock != TimestampSource::kArrival) {
        ClockEstimate& clock = clock_of(lane, arrived.clock);
        time_ns = clock.add(arrived.timestamp_ns, arrived.arrival_ns);
        lane.counts.clock_drift_ppm = clock.drift_ppm();
        if (!clock.settled()) {
            if (complete) ++lane.counts.warmup_image_count;
            return;
        }
    }
    lane.latest_time_ns = std::max(lane.latest_time_ns.value_or(time_ns), time_ns);
    // Belongs to the set handed out last, unless that one has this camera's image: then it belongs to the
    // next.
    if (last_time_ns_ && time_ns <= *last_time_ns_ + (lane.in_last_set ? 0 : tolerance_ns_)) {
        if (complete) ++lane.counts.late_image_count;
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
        true, time_ns, arrived.arrival_ns, arrived.clock, arrived.timestamp_ns, std::move(arrived.image)};
}

bool FrameSetAssembler::is_ready(const Pending& set, std::int64_t now_ns) const {
    if (now_ns >= set.begin_ns + max_wait_ns_ || pending_.size() > kMaxPending) return true;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        const auto& latest_ns =
            lanes_[c].latest_time_ns;  // empty: just connected, its clock is not estimated yet
        if (set.slots[c].there || !lanes_[c].connected) continue;
        if (!latest_ns) {
            if (!last_time_ns_) return false;  // at the start this holds for all of them
            continue;
        }
        // Images arrive in order: after a later one, none follows for this set.
        if (*latest_ns <= set.time_ns + tolerance_ns_) return false;
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

// Times of images on one shared clock differ exactly as their timestamps do; the varying clock estimate only
// maps them to the steady clock.
void FrameSetAssembler::compare_directly(std::vector<Slot>& slots) {
    const Slot* first = nullptr;
    for (Slot& slot : slots) {
        if (!slot.there || slot.clock != TimestampSource::kPtp) continue;
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
        if (slot.image.empty()) continue;
        first_ns = complete ? std::min(first_ns, slot.time_ns) : slot.time_ns;
        last_ns = complete ? std::max(last_ns, slot.time_ns) : slot.time_ns;
        first_arrival_ns = complete ? std::min(first_arrival_ns, slot.arrival_ns) : slot.arrival_ns;
        mean_ns += static_cast<double>(slot.time_ns - set.time_ns);
        ++complete;
    }
    if (complete < std::max<std::size_t>(1, std::min(options_.min_images, lanes_.size()))) {
        for (std::size_t c = 0; c < lanes_.size(); ++c)
            if (!set.slots[c].image.empty()) ++lanes_[c].counts.unmatched_image_count;
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
    const std::int64_t midpoint_ns = first_ns + (last_ns - first_ns) / 2;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        Slot& slot = set.slots[c];
        Lane& lane = lanes_[c];
        out.image_times_ns.push_back(slot.image.empty() ? out.capture_time_ns : slot.time_ns);
        if (!slot.image.empty()) {
            ++lane.counts.image_count;
            lane.skew_ms.add(static_cast<double>(slot.time_ns - midpoint_ns) * 1e-6);
            lane.lateness_ms.add(static_cast<double>(slot.arrival_ns - first_arrival_ns) * 1e-6);
        }
        out.images.push_back(std::move(slot.image));
    }
    return out;
}

std::optional<std::int64_t> FrameSetAssembler::due_ns() const {
    if (pending_.empty()) return std::nullopt;
    return pending_.front().begin_ns + max_wait_ns_;
}

void FrameSetAssembler::fill(std::size_t camera, CameraConnection& link) const {
    const Lane& lane = lanes_.at(camera);
    link.connected = lane.connected;
    link.timestamp_source = lane.counts.timestamp_source;
    link.image_count = lane.counts.image_count;
    link.lost_image_count = lane.counts.lost_image_count;
    link.incomplete_image_count = lane.counts.incomplete_image_count;
    link.late_image_count = lane.counts.late_image_count;
    link.unmatched_image_count = lane.counts.unmatched_image_count;
    link.warmup_image_count = lane.counts.warmup_image_count;
    link.clock_drift_ppm = lane.counts.clock_drift_ppm;
    link.mean_skew_ms = lane.skew_ms.mean();
    link.max_abs_skew_ms = lane.skew_ms.max_abs();
    link.mean_arrival_delay_ms = lane.lateness_ms.mean();
    link.max_arrival_delay_ms = lane.lateness_ms.max_abs();
}

}  // namespace kinevox
