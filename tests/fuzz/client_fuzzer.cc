#include <cstdint>
#include <string>

#include "client/lib/image.h"
#include "client/lib/pose_csv.h"
#include "common/body_table.h"
#include "common/volume_codec.h"
#include "tests/fuzz/fuzz_check.h"

// A client's decoding of messages from an untrusted daemon: volumes, images, CSV lines.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox;
    if (const auto image = client::decode_jpeg({data, size}); image.ok()) {
        FUZZ_CHECK(image->width > 0 && image->height > 0 && (image->channels == 1 || image->channels == 3));
        FUZZ_CHECK(image->data.size() == static_cast<std::size_t>(image->width) *
                                             static_cast<std::size_t>(image->height) *
                                             static_cast<std::size_t>(image->channels));
    }
    if (v1::StreamVolumesResponse message; message.ParseFromArray(data, static_cast<int>(size))) {
        for (const v1::SubjectVolume& subject : message.subjects()) {
            const std::string& bytes = subject.encoded_volume();
            const auto volume =
                decode_volume({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
            FUZZ_CHECK(!volume.ok() || volume_problem(*volume).empty());
        }
    }
    if (v1::StreamPosesResponse message; message.ParseFromArray(data, static_cast<int>(size)))
        for (const auto columns : {client::PoseColumns::kAngles, client::PoseColumns::kJoints,
                                   client::PoseColumns::kCoordinates}) {
            const std::string header = client::pose_csv_header(columns);
            for (const std::string& line : client::pose_csv_lines(columns, message, 0)) {
                FUZZ_CHECK(std::ranges::count(line, ',') == std::ranges::count(header, ','));
                FUZZ_CHECK(line.find('\n') == std::string::npos);
            }
        }
    return 0;
}
