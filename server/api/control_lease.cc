#include "server/api/control_lease.h"

#include <fmt/format.h>

#include <algorithm>
#include <random>

namespace kinevox {
namespace {

constexpr std::size_t kMaxNameBytes = 100;

std::string random_id() {
    std::random_device device;  // the kernel's random numbers
    return fmt::format("{:08x}{:08x}{:08x}{:08x}", device(), device(), device(), device());
}

double seconds(std::chrono::milliseconds duration) {
    return static_cast<double>(duration.count()) / 1000;
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

absl::StatusOr<ControlLease::Granted> ControlLease::acquire(const std::string& operator_name,
                                                            std::chrono::milliseconds timeout,
                                                            const std::string& held_id) {
    if (operator_name.empty() || operator_name.size() > kMaxNameBytes)
        return absl::InvalidArgumentError(fmt::format("operator_name has {} bytes; 1 to {} bytes are allowed",
                                                      operator_name.size(), kMaxNameBytes));
    if (std::ranges::any_of(operator_name, [](unsigned char c) { return c < 0x20 || c == 0x7f; }))
        return absl::InvalidArgumentError(
            "operator_name contains a control character; use printable ones only");
    if (timeout.count() < 0 || timeout > options_.max_timeout)
        return absl::InvalidArgumentError(
            fmt::format("timeout is {} s; this daemon grants up to {} s, or {} s by default (0)",
                        seconds(timeout), seconds(options_.max_timeout), seconds(options_.default_timeout)));
    if (timeout.count() == 0) timeout = options_.default_timeout;
    Granted granted;
    {
        const std::scoped_lock lock(mutex_);
        const Clock::time_point now = now_();
        const bool held = lease_ && lease_->end > now;
        if (held && lease_->id != held_id) return refusal(held_id, now);
        granted = {held ? lease_->id : random_id(), timeout};
        lease_ = Lease{granted.lease_id, operator_name, timeout, now + timeout};
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
    std::string operator_name;
    {
        const std::scoped_lock lock(mutex_);
        if (const absl::Status refused = refusal(lease_id, now_()); !refused.ok()) return refused;
        operator_name = lease_->operator_name;
        lease_.reset();
    }
    on_change_();
    return operator_name;
}

std::optional<ControlLease::Holder> ControlLease::holder() const {
    const std::scoped_lock lock(mutex_);
    const Clock::time_point now = now_();
    if (!lease_ || lease_->end <= now) return std::nullopt;
    return Holder{lease_->operator_name, until(lease_->end, now)};
}

std::optional<std::string> ControlLease::take_expired() {
    const std::scoped_lock lock(mutex_);
    if (!lease_ || lease_->end > now_()) return std::nullopt;
    std::string operator_name = lease_->operator_name;
    lease_.reset();
    return operator_name;
}

absl::Status ControlLease::refusal(const std::string& lease_id, Clock::time_point now) const {
    if (lease_ && lease_->end > now) {
        if (lease_->id == lease_id) return absl::OkStatus();
        return absl::FailedPreconditionError(
            fmt::format("control is held by '{}' for another {:.1f} s; try again then, or have it released",
                        lease_->operator_name, seconds(until(lease_->end, now))));
    }
    if (lease_id.empty())
        return absl::FailedPreconditionError(
            "this requires control, which is free; call AcquireControl first and send its lease_id");
    return absl::FailedPreconditionError("this lease has expired or was released; call AcquireControl again");
}

}  // namespace kinevox
