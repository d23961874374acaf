// A simulated GigE Vision camera for tests: control (GVCP), images (GVSP), resends, triggers, its own clock,
// and an unreliable network. One thread, no state outside this object. When stopped it disappears without a
// message, like an unplugged camera.
#pragma once

#include <absl/status/status.h>
#include <netinet/in.h>

#include <atomic>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tests/support/fake_gige/network.h"
#include "tests/support/fake_gige/registers.h"
#include "tests/support/fake_gige/scene.h"

namespace kinevox::testing {

struct FakeCameraOptions {
    std::string address = "127.0.0.1";  // of this machine; port 3956
    std::string serial = "F1", name;
    double external_fps = 30;  // of the generator on Line1: pulses at multiples of its period, UTC
    double clock_offset_s = 0, clock_drift_ppm = 0;  // of its own clock
    double phase_ms = 0;  // it takes its images so much after the pulse, or the beginning of the second
    std::uint16_t first_block = 1;
    std::filesystem::path empty_while;  // the scene is empty while this file exists
    NetworkOptions network;
};

class FakeCamera {
  public:
    FakeCamera(const FakeCameraOptions& options, Scene scene);
    ~FakeCamera();
    FakeCamera(const FakeCamera&) = delete;
    FakeCamera& operator=(const FakeCamera&) = delete;

    // Unavailable where the address cannot be listened on.
    absl::Status listen();
    // Until `stop` is true.
    void run(const std::atomic<bool>& stop);

    const NetworkCounts& counts() const { return network_->counts(); }
    std::uint64_t images_taken() const { return taken_; }
    const Registers& registers() const { return registers_; }

  private:
    void receive(int socket);
    void answer(std::span<const std::uint8_t> request, const sockaddr_in& from);
    void resend(std::span<const std::uint8_t> body, std::uint8_t flags);
    bool write_register(std::uint32_t address, std::uint32_t value, const sockaddr_in& from);
    void fire_test_packet();
    void take_image(std::int64_t utc_ns, std::int64_t steady_ns);  // when
    std::int64_t next_pulse_utc_ns(std::int64_t now_utc_ns) const;
    double period_ns() const;
    bool streaming() const { return streaming_; }
    void end_of_control();

    const FakeCameraOptions options_;
    Scene scene_;
    Registers registers_;
    int socket_ = -1;             // control and stream
    std::vector<int> listeners_;  // of broadcasts
    std::unique_ptr<LossyNetwork> network_;
    std::optional<sockaddr_in> controller_;
    std::int64_t heard_ns_ = 0;  // of the controller, steady clock
    bool streaming_ = false;
    std::int64_t next_image_utc_ns_ = 0;
    std::uint16_t block_ = 1;
    std::uint64_t taken_ = 0;
    std::deque<std::shared_ptr<SentImage>> sent_;  // to resend from
};

}  // namespace kinevox::testing
