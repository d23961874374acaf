// Saves the next volume of the first subject as PLY.   usage: save_volume FILE.ply [HOST:PORT]
#include <cstdio>

#include "client/lib/client.h"

int main(int argc, char** argv) {
    using namespace kinevox;
    if (argc < 2) {
        std::fprintf(stderr, "usage: save_volume FILE.ply [HOST:PORT]\n");
        return 1;
    }
    client::Client client({.server = argc > 2 ? argv[2] : client::kDefaultServer});
    v1::StreamVolumesRequest request;
    request.set_max_voxel_m(0.02);
    absl::Status written = absl::NotFoundError("the stream ended without a volume");
    const absl::Status streamed =
        client.stream_volumes(request,
                              [&](const client::VolumeFrame& frame) {
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
