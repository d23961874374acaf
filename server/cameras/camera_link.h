// What a live source tells of each of its cameras besides the pictures: whether it is there, what it lost,
// how well it keeps time with the others.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace kinevox {

// What a picture's time was taken by.
enum class CameraClock {
    kUnknown,  // no picture yet
    kArrival,  // this machine's clock when the picture's first packet arrived: the camera gives no timestamps
    kDevice,   // the camera's own clock; its offset and drift against this machine's are estimated
    kPtp,      // a clock that the cameras keep together (IEEE 1588): compared directly
};

// Counts are since the source was opened and go on when a camera comes back. Every picture that a camera sent
// is in exactly one of pictures, lost, incomplete, late, unmatched and settling.
struct CameraLink {
    bool connected = false;  // delivers pictures
    std::string device;      // maker, model, serial number and address, as far as known
    std::string problem;     // why it is not connected, with the remedy; empty while it is
    CameraClock clock = CameraClock::kUnknown;

    std::uint64_t pictures = 0;     // complete and in a frame set
    std::uint64_t lost = 0;         // numbers missing between two pictures: of these nothing arrived
    std::uint64_t incomplete = 0;   // packets were missing when their time was over; never handed on
    std::uint64_t late = 0;         // complete, but their frame set was gone
    std::uint64_t unmatched = 0;    // complete, but too few other cameras had one of the same time
    std::uint64_t settling = 0;     // came while the camera's clock was not known well enough yet
    std::uint64_t disconnects = 0;  // times that it went away

    std::uint64_t packets_missing = 0;  // that never came, not even on request
    std::uint64_t packets_resent = 0;   // came on request
    std::uint64_t resend_requests = 0;  // packets asked for again
    std::uint64_t underruns = 0;        // no buffer was free for a picture; counted in lost, too
    int packet_bytes = 0;               // as negotiated; 0: no network camera

    double skew_ms = 0;      // its time against the middle of its frame sets, signed, mean of the newest 128
    double skew_max_ms = 0;  // the largest of these without sign
    double lateness_ms = 0;  // its pictures' arrival behind the first of their set, mean of the newest 128
    double lateness_max_ms = 0;  // the largest of these
    double clock_drift_ppm = 0;  // of its clock against this machine's
};

struct CameraEvent {
    enum class Kind {
        kLost,      // it was there and delivers nothing any more, or was not there at the start
        kRejoined,  // it delivers again
        kLosses,    // pictures of it were lost or incomplete; told at most every ten seconds
    };
    Kind kind{};
    std::size_t camera = 0;  // its place in FrameSource::cameras()
    std::string message;     // one line for people
};

using OnCameraEvent = std::function<void(const CameraEvent&)>;

}  // namespace kinevox
