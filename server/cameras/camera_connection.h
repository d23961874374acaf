// The connection of a live camera: whether it delivers images, what was lost, how well it is synchronised
// with the other cameras.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace kinevox {

// Where the time of an image comes from.
enum class TimestampSource {
    kUnknown,  // no image yet
    kArrival,  // this machine's clock when the first packet arrived: the camera provides no timestamps
    kDevice,   // the camera's own clock; its offset and drift against this machine's clock are estimated
    kPtp,      // a clock synchronised across the cameras (IEEE 1588); timestamps are compared directly
};

// Counts start when the source is opened and continue after a reconnection. Every image that a camera sent is
// counted in exactly one of image_count and the lost, incomplete, late, unmatched and warm-up counts.
struct CameraConnection {
    bool connected = false;     // delivers images
    std::string device;         // vendor, model, serial number and address, as far as known
    std::string error_message;  // why it is not connected, with the remedy; empty while connected
    TimestampSource timestamp_source = TimestampSource::kUnknown;

    std::uint64_t image_count = 0;             // complete and part of a frame set
    std::uint64_t lost_image_count = 0;        // gaps in the image numbers: nothing of these arrived
    std::uint64_t incomplete_image_count = 0;  // packets still missing at the timeout; discarded
    std::uint64_t late_image_count = 0;        // complete, but after their frame set had been handed out
    std::uint64_t unmatched_image_count = 0;   // complete, but too few other cameras had one of the same time
    std::uint64_t warmup_image_count = 0;      // arrived before the camera's clock was estimated
    std::uint64_t disconnect_count = 0;

    std::uint64_t missing_packet_count = 0;   // never arrived, not even on request
    std::uint64_t resent_packet_count = 0;    // arrived on request
    std::uint64_t resend_request_count = 0;   // packets requested again
    std::uint64_t buffer_underrun_count = 0;  // no free buffer for an image; counted as lost, too
    int packet_size_bytes = 0;                // as negotiated; 0: not a network camera

    // Against the midpoint of the frame set, over the latest 128 images: signed mean, maximum without sign.
    double mean_skew_ms = 0, max_abs_skew_ms = 0;
    // After the first image of the frame set, over the latest 128 images.
    double mean_arrival_delay_ms = 0, max_arrival_delay_ms = 0;
    double clock_drift_ppm = 0;  // of the camera's clock against this machine's
};

struct CameraEvent {
    enum class Kind {
        kDisconnected,  // stopped delivering images, or was absent at the start
        kReconnected,   // delivers images again
        kImagesLost,    // images were lost or incomplete; reported at most every ten seconds
    };
    Kind kind{};
    std::size_t camera = 0;  // index in FrameSource::cameras()
    std::string message;     // one line for the user
};

using OnCameraEvent = std::function<void(const CameraEvent&)>;

}  // namespace kinevox
