#include "tests/support/fake_gige/fake_camera.h"

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "tests/support/fake_gige/wire.h"

namespace kinevox::testing {
namespace {

constexpr std::uint16_t kPort = 3956;
constexpr std::size_t kKept = 16;  // images to resend from
constexpr std::uint16_t kDiscover = 0x02, kResend = 0x40, kReadRegister = 0x80, kWriteRegister = 0x82,
                        kReadMemory = 0x84, kWriteMemory = 0x86;
constexpr std::uint16_t kInvalidAddress = 0x8003, kAccessDenied = 0x8006, kNotImplemented = 0x8001;

std::int64_t now_ns(clockid_t clock) {
    timespec now{};
    clock_gettime(clock, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

int udp_socket(std::uint32_t address, bool shared) {
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    const int on = 1;
    if (shared) setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &on, sizeof on);
    const int send_bytes = 4 << 20;
    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &send_bytes, sizeof send_bytes);
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(kPort);
    at.sin_addr.s_addr = htonl(address);
    if (bind(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0) return fd;
    close(fd);
    return -1;
}

std::uint32_t parse(const std::string& address) {
    in_addr out{};
    return inet_pton(AF_INET, address.c_str(), &out) == 1 ? ntohl(out.s_addr) : 0;
}

bool same(const sockaddr_in& a, const sockaddr_in& b) {
    return a.sin_addr.s_addr == b.sin_addr.s_addr && a.sin_port == b.sin_port;
}

}  // namespace

FakeCamera::FakeCamera(const FakeCameraOptions& options, Scene scene)
    : options_(options),
      scene_(std::move(scene)),
      registers_(parse(options.address), options.serial, options.name),
      block_(std::max<std::uint16_t>(1, options.first_block)) {}

FakeCamera::~FakeCamera() {
    for (const int fd : listeners_) close(fd);
    if (socket_ >= 0) close(socket_);
}

absl::Status FakeCamera::listen() {
    socket_ = udp_socket(parse(options_.address), false);
    if (socket_ < 0)
        return absl::UnavailableError("cannot listen on " + options_.address +
                                      ":3956: " + std::strerror(errno));
    for (const char* broadcast : {"255.255.255.255", "127.255.255.255"})
        if (const int fd = udp_socket(parse(broadcast), true); fd >= 0) listeners_.push_back(fd);
    network_ = std::make_unique<LossyNetwork>(socket_, options_.network);
    return absl::OkStatus();
}

double FakeCamera::period_ns() const {
    const bool external = registers_.get(reg::kTriggerMode) == 1 && registers_.get(reg::kTriggerSource) == 1;
    return 1e9 / (external ? options_.external_fps : std::max(1.0, registers_.get_double(reg::kFrameRate)));
}

std::int64_t FakeCamera::next_pulse_utc_ns(std::int64_t now_utc_ns) const {
    const double period = period_ns();
    const auto phase = static_cast<std::int64_t>(options_.phase_ms * 1e6);
    const double n =
        std::floor(static_cast<double>(now_utc_ns - phase) / period + 1e-3) + 1;  // it is itself a pulse
    return static_cast<std::int64_t>(n * period) + phase;
}

void FakeCamera::run(const std::atomic<bool>& stop) {
    std::vector<pollfd> fds{{socket_, POLLIN, 0}};
    for (const int fd : listeners_) fds.push_back({fd, POLLIN, 0});
    while (!stop) {
        const std::int64_t now = now_ns(CLOCK_MONOTONIC), utc = now_ns(CLOCK_REALTIME);
        std::int64_t wait_ns = 50'000'000;
        const bool by_itself =
            registers_.get(reg::kTriggerMode) == 0 || registers_.get(reg::kTriggerSource) == 1;
        if (streaming_ && by_itself) {
            // A sensor misses no pulse: where this program comes late, it makes up for it.
            for (int i = 0; i < 100 && utc >= next_image_utc_ns_; ++i) {
                take_image(next_image_utc_ns_, now - (utc - next_image_utc_ns_));
                const bool external = registers_.get(reg::kTriggerMode) == 1;
                next_image_utc_ns_ = external ? next_pulse_utc_ns(next_image_utc_ns_)
                                              : next_image_utc_ns_ + static_cast<std::int64_t>(period_ns());
            }
            wait_ns = std::min(wait_ns, next_image_utc_ns_ - utc);
        }
        if (const auto due = network_->run(now)) wait_ns = std::min(wait_ns, *due - now);
        const timespec timeout{0, std::max<std::int64_t>(0, wait_ns)};
        if (ppoll(fds.data(), fds.size(), &timeout, nullptr) > 0)
            for (const pollfd& fd : fds)
                if (fd.revents & POLLIN) receive(fd.fd);
        if (controller_ &&
            now_ns(CLOCK_MONOTONIC) - heard_ns_ > std::int64_t{registers_.get(reg::kHeartbeatMs)} * 1'000'000)
            end_of_control();
    }
    network_->forget();
}

void FakeCamera::end_of_control() {
    controller_.reset();
    registers_.set(reg::kControl, 0);
    streaming_ = false;
    network_->forget();
}

void FakeCamera::receive(int fd) {
    std::uint8_t buffer[2048];
    sockaddr_in from{};
    for (int i = 0; i < 16; ++i) {  // not for ever: images wait
        socklen_t from_bytes = sizeof from;
        const ssize_t bytes =
            recvfrom(fd, buffer, sizeof buffer, 0, reinterpret_cast<sockaddr*>(&from), &from_bytes);
        if (bytes < 8) return;
        answer({buffer, static_cast<std::size_t>(bytes)}, from);
    }
}

void FakeCamera::answer(std::span<const std::uint8_t> request, const sockaddr_in& from) {
    if (request[0] != 0x42) return;
    const std::uint32_t command = big_endian(request, 2, 2), id = big_endian(request, 6, 2);
    const std::span<const std::uint8_t> body = request.subspan(8);
    if (command == kResend) return resend(body, request[1]);
    if (controller_ && same(*controller_, from)) heard_ns_ = now_ns(CLOCK_MONOTONIC);
    std::vector<std::uint8_t> data;
    Wire out(data);
    std::uint32_t status = 0;
    switch (command) {
        case kDiscover:
            out.bytes(registers_.read(0, 0xf8));
            break;
        case kReadRegister:
            for (std::size_t at = 0; at + 4 <= body.size(); at += 4)
                out.u32(registers_.get(big_endian(body, at, 4)));
            break;
        case kWriteRegister: {
            std::uint32_t written = 0;
            for (std::size_t at = 0; at + 8 <= body.size() && status == 0; at += 8)
                if (write_register(big_endian(body, at, 4), big_endian(body, at + 4, 4), from))
                    ++written;
                else
                    status = kAccessDenied;
            out.u16(0).u16(written);
            break;
        }
        case kReadMemory: {
            const auto read = registers_.read(big_endian(body, 0, 4), big_endian(body, 6, 2));
            if (read.empty())
                status = kInvalidAddress;
            else
                out.u32(big_endian(body, 0, 4)).bytes(read);
            break;
        }
        case kWriteMemory: {
            const bool allowed = controller_ && same(*controller_, from);
            if (!allowed)
                status = kAccessDenied;
            else if (!registers_.write(big_endian(body, 0, 4),
                                       body.subspan(std::min<std::size_t>(4, body.size()))))
                status = kInvalidAddress;
            out.u16(0).u16(status ? 0 : static_cast<std::uint32_t>(body.size() - 4));
            break;
        }
        default:
            status = kNotImplemented;
    }
    if (command != kDiscover && (request[1] & 1) == 0) return;  // no acknowledgement asked for
    std::vector<std::uint8_t> packet;
    Wire(packet)
        .u16(status)
        .u16(command + 1)
        .u16(static_cast<std::uint32_t>(data.size()))
        .u16(id)
        .bytes(data);
    sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&from), sizeof from);
}

bool FakeCamera::write_register(std::uint32_t address, std::uint32_t value, const sockaddr_in& from) {
    if (controller_ && !same(*controller_, from)) return false;
    if (address == reg::kControl) {
        if (value == 0) {
            end_of_control();
            return true;
        }
        controller_ = from;
        heard_ns_ = now_ns(CLOCK_MONOTONIC);
    } else if (!controller_) {
        return false;
    }
    if (address == reg::kPacketSize) {
        const std::uint32_t size = std::clamp<std::uint32_t>(value & 0xffff, 576, 9000);
        registers_.set(address, (value & 0x4000'0000) | size);
        if (value & 0x8000'0000) fire_test_packet();
        return true;
    }
    registers_.set(address, value);
    const std::int64_t utc = now_ns(CLOCK_REALTIME);
    if (address == reg::kAcquisition) {
        streaming_ = value == 1;
        if (streaming_) {
            const bool external = registers_.get(reg::kTriggerMode) == 1;
            next_image_utc_ns_ =
                external ? next_pulse_utc_ns(utc) : utc + static_cast<std::int64_t>(options_.phase_ms * 1e6);
        } else {
            network_->forget();
        }
    } else if (address == reg::kTriggerSoftware) {
        registers_.set(address, 0);
        const bool by_command =
            registers_.get(reg::kTriggerMode) == 1 && registers_.get(reg::kTriggerSource) == 0;
        if (streaming_ && by_command) take_image(utc, now_ns(CLOCK_MONOTONIC));
    } else if (address == reg::kPtpEnable) {
        registers_.set(reg::kPtpStatus, value ? 1 : 0);
    }
    return true;
}

void FakeCamera::fire_test_packet() {
    const std::uint32_t size = registers_.get(reg::kPacketSize) & 0xffff;
    const std::vector<std::uint8_t> packet(size - 28);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(registers_.get(reg::kStreamAddress));
    to.sin_port = htons(static_cast<std::uint16_t>(registers_.get(reg::kStreamPort)));
    sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
}

void FakeCamera::take_image(std::int64_t utc_ns, std::int64_t steady_ns) {
    auto image = std::make_shared<SentImage>();
    const auto frame = static_cast<std::uint64_t>(std::llround(static_cast<double>(utc_ns) / period_ns()));
    const bool empty = !options_.empty_while.empty() && std::filesystem::exists(options_.empty_while);
    image->bytes = scene_.image(scene_.is_pattern() ? block_ : frame, empty, registers_);
    image->block = block_;
    block_ = block_ == 0xffff ? 1 : static_cast<std::uint16_t>(block_ + 1);  // 0 is none
    const double own_ns = static_cast<double>(steady_ns) * (1 + options_.clock_drift_ppm * 1e-6) +
                          options_.clock_offset_s * 1e9;
    image->timestamp_ns = registers_.get(reg::kPtpEnable) ? static_cast<std::uint64_t>(utc_ns)
                                                          : static_cast<std::uint64_t>(std::max(0.0, own_ns));
    image->pixel_format = registers_.get(reg::kPixelFormat);
    image->width = registers_.get(reg::kWidth);
    image->height = registers_.get(reg::kHeight);
    image->packet_payload = (registers_.get(reg::kPacketSize) & 0xffff) - 36;  // IP, UDP and GVSP
    image->to.sin_family = AF_INET;
    image->to.sin_addr.s_addr = htonl(registers_.get(reg::kStreamAddress));
    image->to.sin_port = htons(static_cast<std::uint16_t>(registers_.get(reg::kStreamPort)));
    ++taken_;
    sent_.push_back(image);
    if (sent_.size() > kKept) sent_.pop_front();
    network_->send(image, now_ns(CLOCK_MONOTONIC));
}

void FakeCamera::resend(std::span<const std::uint8_t> body, std::uint8_t flags) {
    if (flags & 0x10) return;  // extended numbers: never announced
    const std::uint32_t block = big_endian(body, 2, 2), first = big_endian(body, 4, 4) & 0xffffff,
                        last = big_endian(body, 8, 4) & 0xffffff;
    const auto image = std::ranges::find(sent_, block, [](const auto& sent) { return sent->block; });
    if (image != sent_.end()) network_->resend(*image, first, last, now_ns(CLOCK_MONOTONIC));
}

}  // namespace kinevox::testing
