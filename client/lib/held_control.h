// Control of the daemon for the lifetime of an object: the one lease policy of all clients.
#pragma once

#include <absl/status/statusor.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "client/lib/client.h"

namespace kinevox::client {

// A lease of 30 s, so that control is free again soon after a client crashes; renewed at a third of it by a
// thread of its own, released by the destructor. `client` must outlive it.
class HeldControl {
  public:
    static absl::StatusOr<std::unique_ptr<HeldControl>> acquire(Client& client,
                                                                const std::string& operator_name);
    ~HeldControl();
    HeldControl(const HeldControl&) = delete;
    HeldControl& operator=(const HeldControl&) = delete;

    const Lease& lease() const { return lease_; }

  private:
    HeldControl(Client& client, Lease lease, std::chrono::milliseconds timeout);

    Client& client_;
    const Lease lease_;
    std::mutex mutex_;
    std::condition_variable_any stopped_;
    std::jthread renewal_;
};

}  // namespace kinevox::client
