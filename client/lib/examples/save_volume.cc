// Saves the next volume of a subject, by default the first one, as PLY.
// usage: save_volume FILE.ply [HOST:PORT [SUBJECT]]
#include <cstdio>
#include <cstdlib>

#include "client/lib/client.h"

int main(int argc, char** argv) {
    using namespace kinevox;
    if (argc < 2) {
        std::fprintf(stderr, "usage: save_volume FILE.ply [HOST:PORT [SUBJECT]]\n");
        return 1;
    }
    client::Client client({.server = argc > 2 ? argv[2] : client::kDefaultServer});
    const auto subject_id = static_cast<std::uint32_t>(argc > 3 ? std::atoi(argv[3]) : 0);  // 0: all
    v1::StreamVolumesRequest request;
    request.set_max_voxel_m(0.02);
    absl::Status written = absl::NotFoundError("the stream ended without a volume");
    const absl::Status streamed =
        client.stream_volumes(request,
                              [&](client::VolumeFrame frame) {
                                  client::keep_subject(frame, subject_id);
                                  const client::SubjectVolume* const subject = frame.first_subject();
                                  if (!subject || !subject->volume) return true;  // no subject yet
                                  written = write_volume_ply(*subject->volume, argv[1]);
                                  std::printf("%s: %.1f litres\n", argv[1], subject->volume_litres);
                                  return false;
                              },
                              {.idle_timeout = std::chrono::seconds(30)});
    const absl::Status& status = streamed.ok() ? written : streamed;
    if (!status.ok()) std::fprintf(stderr, "save_volume: %s\n", std::string(status.message()).c_str());
    return status.ok() ? 0 : 1;
}
