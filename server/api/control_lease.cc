#include "server/api/control_lease.h"

#include <fmt/format.h>

#include <algorithm>
#include <random>

namespace kinevox {
namespace {

constexpr std::size_t kMaxName = 100;

std::string random_id() {
    std::random_device device;  // the system's own random numbers
    return fmt::format("{:08x}{:08x}{:08x}{:08x}", device(), device(), device(), device());
}

std::chrono::milliseconds until(ControlLease::Clock::time_point end, ControlLease::Clock::time_point now) {
    return std::chrono::ceil<std::chrono::milliseconds>(end - now);
}

}  // namespace

ControlLease::ControlLease(const ControlLeaseOptions& options, std::function<Clock::time_point()> now)
    : options_(options), now_(std::move(now)) {}

void ControlLease::set_on_change(std::function<void()> on_change) {
    on_change_ = std::move(on_change);
}

absl::StatusOr<ControlLease::Granted> ControlLease::acquire(const std::string& name,
                                                            std::chrono::milliseconds timeout,
                                                            const std::string& held_id) {
    if (name.empty() || name.size() > kMaxName)
        return absl::InvalidArgumentError(fmt::format(
            "the name has {} bytes; control is taken under a name of 1 to {} bytes", name.size(), kMaxName));
    if (std::ranges::any_of(name, [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
        return absl::InvalidArgumentError("the name holds a control character; take a printable one");
    if (timeout.count() < 0 || timeout > options_.max_timeout)
        return absl::InvalidArgumentError(
            fmt::format("timeout_ms is {}; this daemon grants 1 to {} ms, or 0 for its default of {} ms",
                        timeout.count(), options_.max_timeout.count(), options_.default_timeout.count()));
    if (timeout.count() == 0) timeout = options_.default_timeout;
    Granted granted;
    {
        const std::scoped_lock lock(mutex_);
        const Clock::time_point now = now_();
        const bool held = lease_ && lease_->end > now;
        if (held && lease_->id != held_id) return refusal(held_id, now);
        granted = {held ? lease_->id : random_id(), timeout};
        lease_ = Lease{granted.lease_id, name, timeout, now + timeout};
    }
    on_change_();
    return granted;
}

absl::StatusOr<std::chrono::milliseconds> ControlLease::use(const std::string& lease_id) {
    std::chrono::milliseconds remaining{};
    {
        const std::scoped_lock lock(mutex_);
        const Clock::time_point now = now_();
        if (const absl::Status refused = refusal(lease_id, now); !refused.ok()) return refused;
        lease_->end = now + lease_->timeout;
        remaining = lease_->timeout;
    }
    on_change_();
    return remaining;
}

absl::StatusOr<std::string> ControlLease::release(const std::string& lease_id) {
    std::string name;
    {
        const std::scoped_lock lock(mutex_);
        if (const absl::Status refused = refusal(lease_id, now_()); !refused.ok()) return refused;
        name = lease_->name;
        lease_.reset();
    }
    on_change_();
    return name;
}

std::optional<ControlLease::Holder> ControlLease::holder() const {
    const std::scoped_lock lock(mutex_);
    const Clock::time_point now = now_();
    if (!lease_ || lease_->end <= now) return std::nullopt;
    return Holder{lease_->name, until(lease_->end, now)};
}

std::optional<std::string> ControlLease::take_expired() {
    const std::scoped_lock lock(mutex_);
    if (!lease_ || lease_->end > now_()) return std::nullopt;
    std::string name = lease_->name;
    lease_.reset();
    return name;
}

absl::Status ControlLease::refusal(const std::string& lease_id, Clock::time_point now) const {
    if (lease_ && lease_->end > now) {
        if (lease_->id == lease_id) return absl::OkStatus();
        const double seconds = static_cast<double>(until(lease_->end, now).count()) / 1000;
        return absl::FailedPreconditionError(
            fmt::format("control is held by '{}' for another {:.1f} s; try again then, or have it released",
                        lease_->name, seconds));
    }
    if (lease_id.empty())
        return absl::FailedPreconditionError(
            "this needs control and nobody holds it; call AcquireControl first and "
            "send its lease_id");
    return absl::FailedPreconditionError("this lease has run out or was released; call AcquireControl again");
}

}  // namespace kinevox
