#include "server/cameras/aravis/camera_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <mutex>

#include "server/cameras/aravis/aravis_camera.h"
#include "server/cameras/aravis/pixel_format.h"

namespace kinevox {
namespace {

constexpr int kBuffers = 24;                         // owned by Aravis; 0.8 s at 30 images per second
constexpr unsigned kSocketBytes = 8u << 20;          // the kernel grants what net.core.rmem_max allows
constexpr std::uint32_t kControlPrivilege = 0x0a00;  // a register that every GigE Vision camera has

std::int64_t steady_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

// Unwraps image numbers: those of GigE Vision have 16 bits and skip 0.
class ImageNumber {
  public:
    std::uint64_t unwrap(std::uint64_t number, bool counts_from_0) {
        if (counts_from_0) return number + 1;
        if (number < last_ && last_ <= 0xffff && last_ - number > 0x8000) base_ += 0xffff;
        last_ = number;
        return base_ + number;
    }
    // Number of an image whose own is unknown: the one after the last, so that the next image reveals a gap.
    // 0 before the first image.
    std::uint64_t following() { return last_ == 0 ? 0 : unwrap(last_ == 0xffff ? 1 : last_ + 1, false); }

  private:
    std::uint64_t base_ = 0, last_ = 0;
};

// Aravis writes the number and times of an image when its first packet arrives. If it never does, the buffer
// keeps those of its previous image; so they are cleared.
void requeue(ArvStream* stream, ArvBuffer* buffer) {
    arv_buffer_set_frame_id(buffer, 0);
    arv_stream_push_buffer(stream, buffer);
}

}  // namespace

struct CameraSession::State {
    std::string name;
    int width = 0, height = 0;
    bool is_gige = false, wants_ptp = false;
    GHandle<ArvCamera> camera;
    GHandle<ArvStream> stream;
    std::size_t payload = 0;
    int packet_bytes = 0;
    bool timestamps = false;
    std::atomic<bool> ptp = false, lost = false;
    ImageNumber number;
    std::mutex features;  // Aravis' feature tree is not thread-safe: trigger and reader

    ~State() {
        if (camera && !lost) {
            GCatch error;
            arv_camera_stop_acquisition(camera.get(), error);
        }
        stream.reset();  // before the device, which its thread uses
    }

    absl::Status open(const FoundCamera& found);
    absl::Status stream_on(const LiveSourceConfig& config);
    absl::Status refused(const std::string& what, const GCatch& error) const {
        return absl::UnavailableError(fmt::format("camera {}: {}: {}", name, what, error.message()));
    }
};

absl::Status CameraSession::State::open(const FoundCamera& found) {
    GCatch error;
    GHandle<ArvDevice> device;
    {
        const std::scoped_lock lock(aravis_list_mutex());
        device.reset(arv_open_device(found.id.c_str(), error));
    }
    if (!device) return refused(describe(found) + " cannot be opened", error);
    g_signal_connect(device.get(), "control-lost",
                     G_CALLBACK(+[](ArvDevice*, void* state) { static_cast<State*>(state)->lost = true; }),
                     this);
    camera.reset(arv_camera_new_with_device(device.get(), error));
    if (!camera) return refused(describe(found) + " is not a camera", error);
    is_gige = arv_camera_is_gv_device(camera.get());
    if (is_gige && !arv_gv_device_is_controller(ARV_GV_DEVICE(device.get()))) {
        lost = true;  // never controlled: nothing to release
        return absl::PermissionDeniedError(
            fmt::format("camera {}: another program controls {}; stop that program", name, describe(found)));
    }
    return absl::OkStatus();
}

absl::Status CameraSession::State::stream_on(const LiveSourceConfig& config) {
    GCatch error;
    if (is_gige) {
        // Small packets cause losses on a busy machine: use the largest that the network carries.
        if (config.packet_size_bytes > 0)
            arv_camera_gv_set_packet_size(camera.get(), config.packet_size_bytes, error);
        else
            arv_camera_gv_auto_packet_size(camera.get(), error);
        if (error.caught())
            return refused("the packet size cannot be negotiated; set packet_size_bytes", error);
        arv_camera_gv_set_packet_size_adjustment(camera.get(), ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
        // The same reception path for every user: Aravis would use raw sockets if the daemon may.
        arv_camera_gv_set_stream_options(camera.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
        packet_bytes = static_cast<int>(arv_camera_gv_get_packet_size(camera.get(), error));
        auto* device = ARV_GV_DEVICE(arv_camera_get_device(camera.get()));
        timestamps = arv_gv_device_get_timestamp_tick_frequency(device, error) > 0 && !error.caught();
    } else {
        timestamps = true;
    }
    payload = arv_camera_get_payload(camera.get(), error);
    if (error.caught() || payload == 0) return refused("it does not report its image size", error);
    stream.reset(arv_camera_create_stream(camera.get(), nullptr, nullptr, error));
    if (!stream) return refused("its stream cannot be opened", error);
    if (is_gige) {
        // An image is discarded some time before its frame set is completed without it.
        const auto retention_us = static_cast<unsigned>(std::max(20.0, 0.8 * config.max_wait_ms) * 1000);
        g_object_set(
            stream.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
            kSocketBytes, "packet-resend",
            config.packet_resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
            "packet-request-ratio", 1.0, "packet-timeout", 20000u, "frame-retention", retention_us, nullptr);
    }
    for (int i = 0; i < kBuffers; ++i) arv_stream_push_buffer(stream.get(), arv_buffer_new_allocate(payload));
    arv_camera_start_acquisition(camera.get(), error);
    if (error.caught()) return refused("it does not start", error);
    return absl::OkStatus();
}

CameraSession::CameraSession(std::unique_ptr<State> state) : state_(std::move(state)) {}
CameraSession::~CameraSession() = default;

absl::StatusOr<std::unique_ptr<CameraSession>> CameraSession::open(const FoundCamera& found,
                                                                   const LiveSourceConfig& config,
                                                                   const LiveCameraConfig& camera, int width,
                                                                   int height) {
    auto state = std::make_unique<State>();
    state->name = camera.name;
    state->width = width;
    state->height = height;
    state->wants_ptp = config.ptp;
    if (absl::Status status = state->open(found); !status.ok()) return status;
    if (absl::Status status = apply_settings(state->camera.get(), config, camera, width, height);
        !status.ok())
        return status;
    if (config.ptp) enable_ptp(state->camera.get());
    if (absl::Status status = state->stream_on(config); !status.ok()) return status;
    std::unique_ptr<CameraSession> session(new CameraSession(std::move(state)));
    session->update_clock();
    return session;
}

CameraSession::Outcome CameraSession::next(std::chrono::milliseconds timeout, ImagePool& pool,
                                           ArrivedImage& out) {
    ArvBuffer* buffer = arv_stream_timeout_pop_buffer(
        state_->stream.get(), static_cast<std::uint64_t>(std::chrono::microseconds(timeout).count()));
    if (!buffer) return Outcome::kNothing;
    const std::int64_t now_ns = steady_now_ns();
    const ArvBufferStatus status = arv_buffer_get_status(buffer);
    if (status == ARV_BUFFER_STATUS_ABORTED || status == ARV_BUFFER_STATUS_CLEARED) {
        requeue(state_->stream.get(), buffer);
        return Outcome::kNothing;
    }
    out.image = {};
    const bool first_packet_came =
        !state_->is_gige || status == ARV_BUFFER_STATUS_SUCCESS || arv_buffer_get_frame_id(buffer) != 0;
    if (!first_packet_came) {
        out.number = state_->number.following();
        out.clock = TimestampSource::kUnknown;
        out.arrival_ns = now_ns;
        requeue(state_->stream.get(), buffer);
        return Outcome::kImage;
    }
    // Aravis stores the arrival of the first packet in UTC.
    const std::int64_t ago_ns =
        g_get_real_time() * 1000 - static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
    out.arrival_ns = ago_ns >= 0 && ago_ns < 5'000'000'000 ? now_ns - ago_ns : now_ns;
    out.number = state_->number.unwrap(arv_buffer_get_frame_id(buffer), !state_->is_gige);
    out.timestamp_ns = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
    const bool has_timestamp = state_->timestamps && out.timestamp_ns != 0;
    out.clock = !has_timestamp ? TimestampSource::kArrival
                : state_->ptp  ? TimestampSource::kPtp
                               : TimestampSource::kDevice;
    if (status == ARV_BUFFER_STATUS_SUCCESS) {
        std::size_t bytes = 0;
        const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &bytes));
        const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
        const auto format = static_cast<std::uint32_t>(arv_buffer_get_image_pixel_format(buffer));
        if (width == state_->width && height == state_->height) {
            auto memory = pool.take();
            if (to_bgr(format, {data, bytes}, width, height, memory.get()).ok())
                out.image = {width, height, 3, std::move(memory)};
        }
    }
    requeue(state_->stream.get(), buffer);
    return Outcome::kImage;
}

bool CameraSession::control_lost() const {
    return state_->lost;
}

bool CameraSession::answers() {
    if (state_->lost) return false;
    const std::scoped_lock lock(state_->features);
    GCatch error;
    if (state_->is_gige) {
        guint32 value = 0;
        arv_device_read_register(arv_camera_get_device(state_->camera.get()), kControlPrivilege, &value,
                                 error);
        if (!error.caught() && value != 0) return true;
    } else {
        arv_camera_get_payload(state_->camera.get(), error);
        if (!error.caught()) return true;
    }
    state_->lost = true;
    return false;
}

void CameraSession::trigger() {
    if (state_->lost) return;
    const std::scoped_lock lock(state_->features);
    GCatch error;
    arv_camera_software_trigger(state_->camera.get(), error);
}

void CameraSession::update_clock() {
    if (!state_->wants_ptp || state_->lost) return;
    const std::scoped_lock lock(state_->features);
    state_->ptp = has_ptp_time(state_->camera.get());
}

void CameraSession::fill(CameraConnection& link) const {
    const auto statistic = [&](const char* name) {
        return arv_stream_get_info_uint64_by_name(state_->stream.get(), name);
    };
    guint64 completed = 0, failures = 0, underruns = 0;
    arv_stream_get_statistics(state_->stream.get(), &completed, &failures, &underruns);
    link.buffer_underrun_count = underruns;
    link.packet_size_bytes = state_->packet_bytes;
    if (!state_->is_gige) return;
    link.missing_packet_count = statistic("n_missing_packets");
    link.resent_packet_count = statistic("n_resent_packets");
    link.resend_request_count = statistic("n_resend_requests");
}

}  // namespace kinevox
