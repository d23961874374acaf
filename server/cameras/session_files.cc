#include "server/cameras/session_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>
#include <utility>

#include "common/files.h"
#include "common/session_file.h"
#include "server/cameras/image_reader.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMaxTableBytes = std::size_t{1} << 30;

absl::Status cut(const fs::path& file, std::uint64_t bytes) {
    std::error_code error;
    if (fs::file_size(file, error) <= bytes && !error) return absl::OkStatus();
    if (!error) fs::resize_file(file, bytes, error);
    return error ? absl::UnavailableError(
                       fmt::format("{}: {}; it cannot be repaired", file.string(), error.message()))
                 : absl::OkStatus();
}

// Each line of a table begins with its frame. Returns the size in bytes of the header and the complete lines
// of frames below `limit`, and the frame after the last of them.
std::pair<std::size_t, std::uint64_t> complete_lines(std::string_view text, std::uint64_t limit) {
    std::size_t end = text.find('\n') + 1;  // 0 without one
    std::uint64_t next = 0;
    while (end > 0) {
        const std::size_t newline = text.find('\n', end);
        if (newline == std::string_view::npos) break;
        std::uint64_t frame = 0;
        const auto [end_of_number, code] = std::from_chars(text.data() + end, text.data() + newline, frame);
        if (code != std::errc{} || *end_of_number != ',' || frame >= limit) break;
        end = newline + 1;
        next = frame + 1;
    }
    return {end, next};
}

// Cuts all pose tables to the same last frame.
absl::Status cut_poses(const fs::path& folder, std::uint64_t frames) {
    std::vector<std::pair<fs::path, std::string>> tables;
    for (const std::string_view name : kPoseTableNames) {
        auto text = read_file(folder / name, kMaxTableBytes);
        if (!text.ok()) return text.status();
        tables.emplace_back(folder / name, *std::move(text));
    }
    std::uint64_t limit = frames;
    for (std::size_t t = 0; t + 1 < tables.size(); ++t)
        limit = std::min(limit, complete_lines(tables[t].second, limit).second);
    for (const auto& [file, text] : tables)
        if (absl::Status done = cut(file, complete_lines(text, limit).first); !done.ok()) return done;
    return absl::OkStatus();
}

constexpr std::size_t kBackgroundBytes = std::size_t{512} << 20;
constexpr std::size_t kMaxBackgroundImages = 64;  // twice the default N
constexpr double kMaxFrame = 1e15;                // still exact as a double

// Up to `max_images` background images, evenly spread over the file.
absl::StatusOr<std::vector<Image>> read_background(const std::filesystem::path& file, const Camera& camera,
                                                   std::size_t max_images) {
    auto reader = open_images(file, camera);
    if (!reader.ok()) return reader.status();
    const std::int64_t promised = (*reader)->promised();
    const std::int64_t step = std::max<std::int64_t>(
        1, promised / static_cast<std::int64_t>(std::min<std::size_t>(max_images, 1 << 30)));
    std::vector<Image> images;
    for (std::int64_t n = 0; images.size() < max_images; ++n) {
        auto image = (*reader)->next();
        if (absl::IsOutOfRange(image.status())) break;
        if (!image.ok()) return image.status();
        if (n % step == 0) images.push_back(std::move(*image));
    }
    return images;
}

absl::Status check_lengths(const SessionFiles& files, const std::vector<std::int64_t>& lengths) {
    const auto [shortest, longest] = std::ranges::minmax_element(lengths);
    if (*shortest == *longest) return absl::OkStatus();
    const auto camera = static_cast<std::size_t>(shortest - lengths.begin());
    return absl::InvalidArgumentError(fmt::format(
        "camera {}: {} has {} frames, that of camera {} has {}; all cameras of a session need the same "
        "number: copy the file again or trim all to {} frames",
        files.cameras[camera].name, files.session.cameras[camera].video.string(), *shortest,
        files.cameras[static_cast<std::size_t>(longest - lengths.begin())].name, *longest, *shortest));
}

// A contiguous range of a camera's images.
class ImageRange final : public ImageReader {
  public:
    ImageRange(std::unique_ptr<ImageReader> all, std::int64_t first, std::int64_t length)
        : all_(std::move(all)), first_(first), length_(length) {}

    std::int64_t promised() const override { return length_; }
    bool promise_is_exact() const override { return true; }
    absl::StatusOr<Image> next() override {
        if (at_ >= length_) return absl::OutOfRangeError("the time range common to all cameras has ended");
        if (sought_)
            if (absl::Status there = all_->seek(first_ + at_); !there.ok()) return there;
        sought_ = false;
        ++at_;
        return all_->next();
    }
    absl::Status seek(std::int64_t frame) override {
        if (frame < 0 || frame > length_)
            return absl::OutOfRangeError(fmt::format(
                "frame {} is out of range; the cameras have {} frames in common", frame, length_));
        at_ = frame;
        sought_ = true;
        return absl::OkStatus();
    }
    absl::Status rewind() override { return seek(0); }

  private:
    const std::unique_ptr<ImageReader> all_;
    const std::int64_t first_, length_;
    std::int64_t at_ = 0;  // what next() delivers
    bool sought_ = true;   // all_ is at another position
};

absl::StatusOr<std::vector<std::int64_t>> count_images(const SessionFiles& files) {
    std::vector<absl::StatusOr<std::int64_t>> counted(files.images.size(), std::int64_t{0});
    {
        std::vector<std::jthread> threads;
        for (std::size_t c = 0; c < counted.size(); ++c)
            threads.emplace_back([&, c] { counted[c] = files.images[c]->count(); });
    }
    std::vector<std::int64_t> lengths;
    for (const auto& count : counted) {
        if (!count.ok()) return count.status();
        lengths.push_back(*count);
    }
    return lengths;
}

// Restricts cameras that started at different times to their common time range.
absl::Status join(SessionFiles& files) {
    const auto lengths = count_images(files);
    if (!lengths.ok()) return lengths.status();
    const auto length = common_length(files.session, *lengths);
    if (!length.ok()) return length.status();
    const std::vector<std::int64_t> first = first_image_indices(files.session);
    for (std::size_t c = 0; c < first.size(); ++c)
        files.images[c] = std::make_unique<ImageRange>(std::move(files.images[c]), first[c], *length);
    return absl::OkStatus();
}

// Opens a recording, possibly truncated, up to the last frame set that all cameras have.
absl::Status open_recording(SessionFiles& files) {
    auto times = complete_frame_sets(files.session);
    if (!times.ok()) return times.status();
    const auto frames = static_cast<std::int64_t>(times->size());
    files.times = FrameTimes(files.session.fps, *std::move(times));
    for (std::size_t c = 0; c < files.cameras.size(); ++c) {
        auto video = RecordedVideo::open(files.session.cameras[c].video, files.cameras[c], frames);
        if (!video.ok()) return video.status();
        files.images.push_back(*std::move(video));
    }
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<RecordedTime>> complete_frame_sets(const Session& session) {
    auto times = read_recorded_times(session.recording->frame_times);
    if (!times.ok()) return times.status();
    for (const SessionCamera& camera : session.cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        times->resize(std::min(times->size(), index->size()));
    }
    if (times->empty())
        return absl::DataLossError(
            fmt::format("session \"{}\": no complete frame set was recorded; record it again", session.name));
    return times;
}

absl::Status check_intact(const fs::path& session_file) {
    const auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    if (!session->recording || !session->recording->closed) return absl::OkStatus();
    const std::uint64_t stated = session->recording->frame_sets;
    const auto times = read_recorded_times(session->recording->frame_times);
    if (!times.ok()) return times.status();
    std::uint64_t complete = times->size();
    fs::path damaged = session->recording->frame_times;
    for (const SessionCamera& camera : session->cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        if (index->size() >= complete) continue;
        complete = index->size();
        damaged = video_index_file(camera.video);
    }
    if (complete >= stated) return absl::OkStatus();
    return absl::DataLossError(
        fmt::format("{}: damaged after {} of {} frame sets; copy the recording again, or set closed = false "
                    "in {} to cut it to "
                    "the intact ones",
                    damaged.string(), complete, stated, session_file.string()));
}

absl::StatusOr<bool> repair_recording(const fs::path& session_file) {
    auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    if (!session->recording || session->recording->closed || being_written(session->recording->frame_times))
        return false;
    const auto times = complete_frame_sets(*session);
    if (!times.ok()) return times.status();
    SessionRecording& recording = *session->recording;
    const std::size_t frames = times->size();
    for (const SessionCamera& camera : session->cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        if (absl::Status done = cut(camera.video, (*index)[frames - 1].end()); !done.ok()) return done;
        if (absl::Status done = cut(video_index_file(camera.video),
                                    kVideoIndexHeader.size() + frames * kVideoIndexEntryBytes);
            !done.ok())
            return done;
        recording.missing_images += static_cast<std::uint64_t>(std::count_if(
            index->begin(), index->begin() + static_cast<std::ptrdiff_t>(frames),
            [](const VideoIndexEntry& entry) { return entry.flags & VideoIndexEntry::kMissing; }));
    }
    const auto table = read_file(recording.frame_times, kMaxTableBytes);
    if (!table.ok()) return table.status();
    if (absl::Status done = cut(recording.frame_times, complete_lines(*table, frames).first); !done.ok())
        return done;
    if (!recording.poses.empty())
        if (absl::Status done = cut_poses(recording.poses, frames); !done.ok()) return done;
    std::error_code ignored;
    fs::remove(session_file.parent_path() / ".reserve", ignored);
    recording.frame_sets = frames;
    recording.start_time_utc_ns = times->front().capture_time_utc_ns;
    recording.lost_frame_sets = times->back().sequence - times->front().sequence + 1 - frames;
    recording.closed = recording.recovered = true;
    recording.end_reason = "the recording program was killed";
    if (absl::Status written = write_session(*session, session_file); !written.ok()) return written;
    return true;
}

std::int64_t FrameTimes::of(std::int64_t frame) const {
    if (recorded_.empty()) return std::llround(1e9 * static_cast<double>(frame) / fps_);
    const auto size = static_cast<std::int64_t>(recorded_.size());
    const std::int64_t round_ns = recorded_.back().time_ns + std::llround(1e9 / fps_);
    return frame / size * round_ns + recorded_[static_cast<std::size_t>(frame % size)].time_ns;
}

std::int64_t FrameTimes::nearest(double seconds) const {
    const auto even = [&](double s) { return std::llround(std::clamp(s * fps_, -kMaxFrame, kMaxFrame)); };
    const auto last = static_cast<std::int64_t>(recorded_.size()) - 1;
    if (last < 0 || seconds < 0) return even(seconds);
    const auto seconds_of = [&](std::int64_t frame) { return 1e-9 * static_cast<double>(of(frame)); };
    if (seconds > seconds_of(last)) return last + even(seconds - seconds_of(last));
    const auto next = std::ranges::lower_bound(
        recorded_, seconds, {}, [](const RecordedTime& t) { return 1e-9 * static_cast<double>(t.time_ns); });
    const std::int64_t frame = next - recorded_.begin();
    return frame > 0 && seconds - seconds_of(frame - 1) < seconds_of(frame) - seconds ? frame - 1 : frame;
}

absl::StatusOr<SessionFiles> open_session_files(Session session) {
    SessionFiles files;
    files.session = std::move(session);
    auto cameras = read_session_cameras(files.session);
    if (!cameras.ok()) return cameras.status();
    files.cameras = *std::move(cameras);
    files.times = FrameTimes(files.session.fps);
    if (files.session.recording) {
        if (absl::Status opened = open_recording(files); !opened.ok()) return opened;
        return files;
    }
    std::vector<std::int64_t> lengths;
    bool exact = true;
    for (std::size_t c = 0; c < files.cameras.size(); ++c) {
        auto reader = open_images(files.session.cameras[c].video, files.cameras[c]);
        if (!reader.ok()) return reader.status();
        exact = exact && (*reader)->promise_is_exact();
        lengths.push_back((*reader)->promised());
        files.images.push_back(*std::move(reader));
    }
    absl::Status fit;
    if (has_offsets(files.session))
        fit = join(files);
    else if (exact)  // otherwise the reader detects the difference at the end
        fit = check_lengths(files, lengths);
    if (!fit.ok()) return fit;
    return files;
}

absl::StatusOr<SessionFiles> open_session_files(const std::filesystem::path& session_file) {
    repair_recording(session_file).IgnoreError();  // readable without the repair
    auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    return open_session_files(*std::move(session));
}

std::size_t frame_set_bytes(const std::vector<Camera>& cameras) {
    std::size_t bytes = 0;
    for (const Camera& camera : cameras) bytes += std::size_t{3} * camera.width * camera.height;
    return std::max<std::size_t>(bytes, 1);
}

absl::StatusOr<std::int64_t> count_frame_sets(const SessionFiles& files) {
    const auto lengths = count_images(files);
    if (!lengths.ok()) return lengths.status();
    if (absl::Status same = check_lengths(files, *lengths); !same.ok()) return same;
    return lengths->front();
}

absl::StatusOr<std::vector<std::vector<Image>>> read_backgrounds(const Session& session,
                                                                 const std::vector<Camera>& cameras) {
    const std::size_t count = cameras.size();
    if (std::ranges::all_of(session.cameras,
                            [](const SessionCamera& camera) { return camera.background.empty(); }))
        return std::vector<std::vector<Image>>{};
    // The recorder stored the images that the background was learned from; all of them reproduce it.
    const std::size_t max_images =
        session.recording
            ? std::numeric_limits<std::size_t>::max()
            : std::clamp<std::size_t>(kBackgroundBytes / frame_set_bytes(cameras), 8, kMaxBackgroundImages);
    std::vector<absl::StatusOr<std::vector<Image>>> read(count, std::vector<Image>{});
    {
        std::vector<std::jthread> threads;
        for (std::size_t c = 0; c < count; ++c)
            if (!session.cameras[c].background.empty())
                threads.emplace_back([&, c] {
                    read[c] = read_background(session.cameras[c].background, cameras[c], max_images);
                });
    }
    std::vector<std::vector<Image>> images;
    for (auto& one : read) {
        if (!one.ok()) return one.status();
        images.push_back(std::move(*one));
    }
    return images;
}

absl::Status each_has_background(const std::vector<std::vector<Image>>& background,
                                 const std::vector<Camera>& cameras, const std::string& session) {
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (c >= background.size() || background[c].empty())
            return absl::InvalidArgumentError(fmt::format(
                "{}: camera {} has no `background`; add an image, a clip or a folder of the empty scene",
                session, cameras[c].name));
    return absl::OkStatus();
}

}  // namespace kinevox
