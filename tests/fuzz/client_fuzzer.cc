#include <cstdint>
#include <string>

#include "client/lib/image_file.h"
#include "client/lib/pose_csv.h"
#include "common/skeleton.h"
#include "common/volume_codec.h"
#include "tests/fuzz/fuzz_check.h"

// What a client makes of a daemon's messages, whoever sent them: a volume, a picture, a line of text.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox;
    if (const auto image = client::decode_jpeg({data, size}); image.ok()) {
        FUZZ_CHECK(image->width > 0 && image->height > 0 && (image->channels == 1 || image->channels == 3));
        FUZZ_CHECK(image->data.size() == static_cast<std::size_t>(image->width) *
                                             static_cast<std::size_t>(image->height) *
                                             static_cast<std::size_t>(image->channels));
    }
    if (v1::StreamVolumesResponse message; message.ParseFromArray(data, static_cast<int>(size))) {
        const auto volume = decode_volume(
            {reinterpret_cast<const std::uint8_t*>(message.volume().data()), message.volume().size()});
        FUZZ_CHECK(!volume.ok() || volume_problem(*volume).empty());
    }
    if (v1::StreamPosesResponse message; message.ParseFromArray(data, static_cast<int>(size)))
        for (const auto part : {client::PosePart::kAngles, client::PosePart::kJoints}) {
            const std::string head = client::pose_csv_head(part),
                              line = client::pose_csv_line(part, message, 0);
            FUZZ_CHECK(std::ranges::count(line, ',') == std::ranges::count(head, ','));
            FUZZ_CHECK(line.find('\n') == std::string::npos);
        }
    return 0;
}
