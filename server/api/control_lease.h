// Who may start, stop and teach the capture: one operator at a time, for as long as he uses or renews his
// lease.
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
        std::string lease_id;  // 128 random bits in hex: who knows it holds control
        std::chrono::milliseconds timeout{};
    };
    struct Holder {
        std::string name;
        std::chrono::milliseconds remaining{};
    };

    explicit ControlLease(const ControlLeaseOptions& options = {},
                          std::function<Clock::time_point()> now = Clock::now);

    void set_on_change(std::function<void()> on_change);  // before the first use

    // InvalidArgument: no name or a bad one, a timeout out of range. FailedPrecondition: somebody else holds
    // control, named in the message with the time left. `held_id` renews a lease already held, with another
    // name or time.
    absl::StatusOr<Granted> acquire(const std::string& name, std::chrono::milliseconds timeout,
                                    const std::string& held_id = {});

    // Whether `lease_id` has control now, and if so renews it. FailedPrecondition says who has it instead.
    absl::StatusOr<std::chrono::milliseconds> use(const std::string& lease_id);

    // The name of who released it. FailedPrecondition as use().
    absl::StatusOr<std::string> release(const std::string& lease_id);

    std::optional<Holder> holder() const;

    // Forgets a lease that has run out and returns its holder's name, once. For the daemon's timer.
    std::optional<std::string> take_expired();

  private:
    struct Lease {
        std::string id, name;
        std::chrono::milliseconds timeout{};
        Clock::time_point end;
    };
    absl::Status refusal(const std::string& lease_id, Clock::time_point now) const;  // mutex held

    const ControlLeaseOptions options_;
    const std::function<Clock::time_point()> now_;
    std::function<void()> on_change_ = [] {};
    mutable std::mutex mutex_;
    std::optional<Lease> lease_;  // may have run out: Lease::end tells
};

}  // namespace kinevox
