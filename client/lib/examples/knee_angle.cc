// Prints time, subject, right knee angle and its standard deviation of each pose.   usage: knee_angle
// [HOST:PORT]
#include <cstdio>

#include "client/lib/client.h"

int main(int argc, char** argv) {
    using namespace kinevox;
    client::Client client({.server = argc > 1 ? argv[1] : client::kDefaultServer});
    const absl::Status status = client.stream_poses(
        {},
        [](const v1::StreamPosesResponse& message) {
            for (const v1::SubjectPose& subject : message.subjects())
                for (const v1::CoordinateEstimate& angle : subject.pose().coordinates())
                    if (angle.name() == "knee_angle_r" && angle.has_value_deg())  // else withheld
                        std::printf("%.3f s  subject %u  %.1f +- %.1f deg\n",
                                    1e-9 * static_cast<double>(message.header().capture_time_ns()),
                                    subject.subject_id(), angle.value_deg(), angle.std_deg());
            return std::fflush(stdout) == 0;  // until nothing reads it
        },
        {.reconnect = true});
    std::fprintf(stderr, "knee_angle: %s\n", std::string(status.message()).c_str());
    return status.ok() ? 0 : 1;
}
