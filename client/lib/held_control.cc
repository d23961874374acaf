#include "client/lib/held_control.h"

#include <algorithm>
#include <utility>

#include "common/proto_time.h"

namespace kinevox::client {
namespace {

constexpr std::chrono::milliseconds kLeaseTimeout{30'000}, kMinTimeout{1'000};

}  // namespace

absl::StatusOr<std::unique_ptr<HeldControl>> HeldControl::acquire(Client& client,
                                                                  const std::string& operator_name) {
    v1::AcquireControlRequest request;
    request.set_operator_name(operator_name);
    *request.mutable_timeout() = to_duration(kLeaseTimeout);
    const auto acquired = client.acquire_control(request);
    if (!acquired.ok()) return acquired.status();
    const std::chrono::milliseconds timeout = to_milliseconds(acquired->timeout());
    return std::unique_ptr<HeldControl>(new HeldControl(client, Lease{acquired->lease_id()}, timeout));
}

HeldControl::HeldControl(Client& client, Lease lease, std::chrono::milliseconds timeout)
    : client_(client), lease_(std::move(lease)), renewal_([this, timeout](const std::stop_token& stop) {
          std::unique_lock lock(mutex_);
          while (!stopped_.wait_for(lock, stop, std::max(timeout, kMinTimeout) / 3, [] { return false; }) &&
                 !stop.stop_requested())
              client_.renew_control(lease_.id).IgnoreError();  // the next call reports what is wrong
      }) {}

HeldControl::~HeldControl() {
    renewal_.request_stop();
    renewal_.join();
    client_.release_control(lease_.id).IgnoreError();  // it may have expired
}

}  // namespace kinevox::client
