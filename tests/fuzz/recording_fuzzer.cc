#include <atomic>
#include <cstdint>
#include <string>

#include "common/recording_files.h"
#include "common/session_file.h"
#include "server/pose/body_shape.h"
#include "server/recording/recording_export.h"
#include "server/recording/trial.h"
#include "server/recording/volume_file.h"
#include "tests/fuzz/fuzz_check.h"
#include "tests/fuzz/fuzzed_folder.h"

namespace {

using namespace kinevox;

void check_line(const absl::Status& status) {
    FUZZ_CHECK(status.message().find('\n') == absl::string_view::npos);
}

void check_index(std::string_view bytes) {
    constexpr std::uint64_t kVideoBytes = 100'000;
    const auto index = parse_video_index(bytes, kVideoBytes);
    if (!index.ok()) return check_line(index.status());
    for (const VideoIndexEntry& entry : *index)
        FUZZ_CHECK(entry.payload_offset <= entry.end() && entry.end() <= kVideoBytes);
}

void check_times(std::string_view text) {
    const auto times = parse_recorded_times(text, "frames.csv");
    if (!times.ok()) return check_line(times.status());
    for (std::size_t i = 1; i < times->size(); ++i)
        FUZZ_CHECK((*times)[i].sequence > (*times)[i - 1].sequence);
}

// A key written into a session is read back.
void check_offsets(const std::string& text) {
    const auto before = parse_session_toml(text, "/trial", "session.toml", false);
    if (!before.ok()) return;
    (void)first_image_indices(*before);
    const std::vector<double> offsets(before->cameras.size(), 0.25);
    const auto written = with_offsets(text, offsets);
    if (!written.ok()) return check_line(written.status());
    const auto after = parse_session_toml(*written, "/trial", "session.toml", false);
    FUZZ_CHECK(after.ok() && after->cameras.size() == before->cameras.size());
    for (const SessionCamera& camera : after->cameras) FUZZ_CHECK(camera.offset_s == 0.25);
}

void check_files(testing::FuzzedFolder& folder, std::string_view bytes) {
    const auto volumes = VolumeFileReader::open(folder.write("volumes.kvxv", bytes));
    check_line(volumes.status());
    if (volumes.ok())
        for (const VolumeFileReader::Entry& entry : volumes->entries())
            check_line(volumes->read(entry).status());
    const auto body = read_body_shape(folder.write("body.toml", bytes));
    check_line(body.status());
    // Tables of a trial: one is this input, the others are valid.
    folder.write("joints.csv", bytes);
    for (const double fps : {0.0, 50.0}) {
        const auto trial = read_trial(folder.path(), fps);
        check_line(trial.status());
        if (trial.ok()) FUZZ_CHECK(trial->size() >= 2 && trial->joints.size() == trial->size());
    }
}

// run.toml of `kinevox process` names the session with the images.
void check_results(testing::FuzzedFolder& folder, std::string_view bytes) {
    folder.write("run.toml", bytes);
    const std::atomic<bool> stop = false;
    check_line(
        export_recording(folder.path(), {.format = ExportFormat::kMp4}, folder.path() / "video.mp4", {stop})
            .status());
}

}  // namespace

// All files of a recording except videos and calibration. Each parser reads every input; most are rejected by
// their first bytes.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static testing::FuzzedFolder folder;
    const std::string bytes(data, data + size);
    check_index(bytes);
    check_times(bytes);
    check_offsets(bytes);
    check_files(folder, bytes);
    check_results(folder, bytes);
    return 0;
}
