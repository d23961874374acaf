#include "server/recording/background_files.h"

#include <cmath>
#include <system_error>

#include "common/recording_files.h"
#include "server/recording/video_file.h"

namespace kinevox {

namespace fs = std::filesystem;

absl::StatusOr<std::vector<fs::path>> write_background_videos(const fs::path& folder,
                                                              const std::vector<Camera>& cameras, double fps,
                                                              const std::vector<std::vector<Image>>& images,
                                                              const std::stop_token& stop) {
    std::vector<fs::path> files;
    std::error_code error;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const fs::path video = folder / (cameras[c].name + ".mkv");
        fs::remove(video, error);  // a recording may have a hard link to the old one
        fs::remove(video_index_file(video), error);
        auto encoder = ImageEncoder::create(cameras[c], fps, VideoCodec::kUtVideo);
        if (!encoder.ok()) return encoder.status();
        auto file = VideoFile::create(video, (*encoder)->format());
        if (!file.ok()) return file.status();
        for (std::size_t n = 0; n < images[c].size(); ++n) {
            if (stop.stop_requested())
                return absl::CancelledError("superseded: the background was learned again");
            const auto encoded = (*encoder)->encode(images[c][n], true);
            if (!encoded.ok()) return encoded.status();
            const auto time_ns = std::llround(1e9 * static_cast<double>(n) / fps);
            if (const absl::Status written = (*file)->append(**encoded, time_ns); !written.ok())
                return written;
        }
        (*file)->close().IgnoreError();
        files.push_back(video);
    }
    return files;
}

}  // namespace kinevox
