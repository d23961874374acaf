// The control lease: one operator at a time may change the capture, while they use or renew the lease.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

namespace kinevox {

struct ControlLeaseOptions {
    std::chrono::milliseconds default_timeout{30'000};
    std::chrono::milliseconds max_timeout{3'600'000};
};

// Any thread. `on_change` is called without a lock held after the holder or the end of the lease has changed.
class ControlLease {
  public:
    using Clock = std::chrono::steady_clock;

    struct Granted {
        std::string lease_id;  // 128 random bits in hex: its knowledge grants control
        std::chrono::milliseconds timeout{};
    };
    struct Holder {
        std::string operator_name;
        std::chrono::milliseconds remaining{};
    };

    explicit ControlLease(const ControlLeaseOptions& options = {},
                          std::function<Clock::time_point()> now = Clock::now);

    void set_on_change(std::function<void()> on_change);  // before the first use

    // InvalidArgument: the name is empty or invalid, the timeout out of range. FailedPrecondition: another
    // operator holds control; the message has the name and the remaining time. `held_id` renews a lease
    // already held, with another name or timeout.
    absl::StatusOr<Granted> acquire(const std::string& operator_name, std::chrono::milliseconds timeout,
                                    const std::string& held_id = {});

    // Renews the lease if `lease_id` holds control, and returns the remaining time. FailedPrecondition names
    // the holder.
    absl::StatusOr<std::chrono::milliseconds> use(const std::string& lease_id);

    // Returns the operator's name. FailedPrecondition as use().
    absl::StatusOr<std::string> release(const std::string& lease_id);

    std::optional<Holder> holder() const;

    // Drops an expired lease and returns its operator's name, once. For the daemon's timer.
    std::optional<std::string> take_expired();

  private:
    struct Lease {
        std::string id, operator_name;
        std::chrono::milliseconds timeout{};
        Clock::time_point end;
    };
    absl::Status refusal(const std::string& lease_id, Clock::time_point now) const;  // mutex held

    const ControlLeaseOptions options_;
    const std::function<Clock::time_point()> now_;
    std::function<void()> on_change_ = [] {};
    mutable std::mutex mutex_;
    std::optional<Lease> lease_;  // expired after Lease::end
};

}  // namespace kinevox
