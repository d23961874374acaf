// Recordings of made-up images: what comes back is what went in.
#include "server/recording/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <future>
#include <mutex>
#include <random>
#include <thread>

#include "common/files.h"
#include "common/recording_files.h"
#include "server/cameras/image_reader.h"
#include "server/cameras/replay_source.h"
#include "server/cameras/session_files.h"
#include "server/cameras/session_source.h"
#include "server/recording/recording_export.h"
#include "server/recording/subject_names.h"
#include "tests/support/fake_capture.h"
#include "tests/support/person_volume.h"
#include "tests/support/small_session.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using testing::fake_cameras;
using testing::TemporaryFolder;
using namespace std::chrono_literals;
using ::testing::HasSubstr;

constexpr double kFps = 100;  // of the fake cameras
constexpr std::int64_t kPeriodNs = 10'000'000;

// Noise, other in each; a lossless codec has no way to be right by chance.
Image noise(const Camera& camera, std::uint64_t seed, int channels = 3) {
    const std::size_t bytes = static_cast<std::size_t>(camera.width) * camera.height * channels;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::mt19937 random(static_cast<unsigned>(seed));
    for (std::size_t i = 0; i < bytes; ++i) data[i] = static_cast<std::uint8_t>(random());
    return {camera.width, camera.height, channels, std::move(data)};
}

FrameSet noise_set(std::uint64_t sequence) {
    FrameSet set;
    set.sequence = sequence;
    set.capture_time_ns = static_cast<std::int64_t>(sequence) * kPeriodNs;
    for (std::size_t c = 0; c < fake_cameras().size(); ++c)
        set.images.push_back(noise(fake_cameras()[c], 10 * sequence + c));
    return set;
}

bool same(const Image& a, const Image& b) {
    return !a.empty() && !b.empty() && a.width == b.width && a.height == b.height &&
           a.channels == b.channels &&
           std::equal(a.data.get(), a.data.get() + static_cast<std::size_t>(a.width) * a.height * a.channels,
                      b.data.get());
}

const BodyShape* no_body(std::uint32_t) {
    return nullptr;
}

class RecorderTest : public ::testing::Test {
  protected:
    RecorderTest() {
        options.folder = folder.path() / "recordings";
        options.min_free_bytes = 0;
    }
    void make() {
        auto made = Recorder::create(
            options,
            [] {
                return RecordedCapture{fake_cameras(), kFps, "c3", "{}"};
            },
            [this](const Event& event) {
                const std::scoped_lock lock(mutex);
                events.push_back(event);
            });
        ASSERT_TRUE(made.ok()) << made.status();
        recorder = *std::move(made);
    }
    // Offered without hurry, so that nothing need be dropped.
    void offer(std::uint64_t first, std::uint64_t count) {
        for (std::uint64_t n = first; n < first + count; ++n) {
            while (recorder->status().queued_bytes > options.max_queue_bytes / 2)
                std::this_thread::sleep_for(1ms);
            recorder->offer(noise_set(n));
            recorder->observe(*testing::fake_result(n, nullptr), no_body);
        }
    }
    void wait_until_written() {
        for (int i = 0; i < 3000 && recorder->status().queued_bytes > 0; ++i)
            std::this_thread::sleep_for(2ms);
        ASSERT_EQ(recorder->status().queued_bytes, 0U);
        std::this_thread::sleep_for(250ms);  // the status follows
    }
    fs::path session_file(const std::string& name) const { return options.folder / name / "session.toml"; }
    std::vector<EventKind> event_kinds() {
        const std::scoped_lock lock(mutex);
        std::vector<EventKind> kinds;
        for (const Event& event : events) kinds.push_back(event.kind);
        return kinds;
    }

    TemporaryFolder folder;
    RecorderOptions options;
    std::mutex mutex;
    std::vector<Event> events;
    std::unique_ptr<Recorder> recorder;
};

// Stepped through and sought in, a replay shows the same at the same times.
void expect_replayed(const fs::path& session_file, const std::vector<FrameSet>& sets) {
    const auto replay = ReplaySource::open(session_file, {.paused = true});
    ASSERT_TRUE(replay.ok()) << replay.status();
    EXPECT_EQ((*replay)->position().frame_count, static_cast<std::int64_t>(sets.size()));
    const auto expect_next = [&](std::size_t n) {
        const auto set = (*replay)->next();
        ASSERT_TRUE(set.ok()) << set.status();
        EXPECT_EQ(set->recorded_frame, static_cast<std::int64_t>(n));
        EXPECT_EQ(set->capture_time_ns, sets[n].capture_time_ns);
        EXPECT_NEAR((*replay)->position().position_s, 1e-9 * static_cast<double>(sets[n].capture_time_ns),
                    1e-9);
        for (std::size_t c = 0; c < sets[n].images.size(); ++c)
            EXPECT_TRUE((set->images[c].empty() && sets[n].images[c].empty()) ||
                        same(set->images[c], sets[n].images[c]))
                << n << " " << c;
        EXPECT_EQ((*replay)->frame_at(1e-9 * static_cast<double>(set->capture_time_ns)),
                  static_cast<std::int64_t>(n));
    };
    for (std::size_t n = 0; n < sets.size(); ++n) {
        ASSERT_NO_FATAL_FAILURE(expect_next(n));
        (*replay)->step(1);
    }
    for (const std::size_t n : {sets.size() / 2, std::size_t{0}, sets.size() - 1}) {
        ASSERT_TRUE((*replay)->seek(static_cast<std::int64_t>(n)).ok());
        ASSERT_NO_FATAL_FAILURE(expect_next(n));
    }
}

// All frame sets of a session as the pipeline would get them.
std::vector<FrameSet> read_all(const fs::path& session_file) {
    auto source = open_session_source(session_file);
    EXPECT_TRUE(source.ok()) << source.status();
    std::vector<FrameSet> sets;
    while (source.ok()) {
        auto set = (*source)->next();
        if (!set.ok()) {
            EXPECT_TRUE(absl::IsOutOfRange(set.status())) << set.status();
            break;
        }
        sets.push_back(*std::move(set));
    }
    if (!sets.empty()) expect_replayed(session_file, sets);
    return sets;
}

void expect_noise_sets(const std::vector<FrameSet>& sets, std::uint64_t first, std::uint64_t count) {
    ASSERT_EQ(sets.size(), count);
    for (std::uint64_t n = 0; n < count; ++n) {
        EXPECT_EQ(sets[n].sequence, n);
        EXPECT_EQ(sets[n].capture_time_ns, static_cast<std::int64_t>(n) * kPeriodNs);
        for (std::size_t c = 0; c < 2; ++c)
            ASSERT_TRUE(same(sets[n].images[c], noise(fake_cameras()[c], 10 * (first + n) + c)))
                << n << " " << c;
    }
}

TEST_F(RecorderTest, LosslessCodecsKeepEveryBit) {
    make();
    std::vector<std::vector<Image>> empty(2);
    for (std::size_t c = 0; c < 2; ++c)
        for (int n = 0; n < 5; ++n) empty[c].push_back(noise(fake_cameras()[c], 1000 + 10 * n + c));
    recorder->background_learned(std::make_shared<const std::vector<std::vector<Image>>>(empty));
    for (const VideoCodec codec : {VideoCodec::kFfv1, VideoCodec::kUtVideo}) {
        const std::string name(name_of(codec));
        offer(0, 3);  // before: not in it
        ASSERT_EQ(*recorder->start(name, codec), name);
        offer(3, 30);
        const auto info = recorder->stop();
        ASSERT_TRUE(info.ok()) << info.status();
        EXPECT_EQ(info->about.frame_sets, 30U);
        EXPECT_EQ(info->about.dropped_frame_sets + info->about.lost_frame_sets + info->about.missing_images,
                  0U);
        expect_noise_sets(read_all(session_file(name)), 3, 30);

        const auto session = read_session(session_file(name));
        ASSERT_TRUE(session.ok()) << session.status();
        EXPECT_TRUE(session->recording->closed);
        EXPECT_EQ(session->recording->calibration_id, "c3");
        EXPECT_TRUE(fs::exists(options.folder / name / "calibration.certificate.json"));
        const auto cameras = read_session_cameras(*session);
        ASSERT_EQ(cameras->size(), 2U);
        for (std::size_t c = 0; c < 2; ++c) {
            EXPECT_EQ((*cameras)[c].name, fake_cameras()[c].name);
            for (std::size_t i = 0; i < 9; ++i)
                EXPECT_NEAR((*cameras)[c].camera_from_world.rotation.m[i],
                            fake_cameras()[c].camera_from_world.rotation.m[i], 1e-15);
        }
        auto source = open_session_source(*session);
        ASSERT_TRUE(source.ok()) << source.status();
        const auto background = (*source)->background();
        ASSERT_TRUE(background.ok()) << background.status();
        for (std::size_t c = 0; c < 2; ++c) {
            ASSERT_EQ((*background)[c].size(), 5U);
            for (std::size_t n = 0; n < 5; ++n) EXPECT_TRUE(same((*background)[c][n], empty[c][n]));
        }
        recorder->capture_ended();
    }
    EXPECT_THAT(event_kinds(),
                ::testing::ElementsAre(EventKind::kRecordingStarted, EventKind::kRecordingStopped,
                                       EventKind::kRecordingStarted, EventKind::kRecordingStopped));
    const auto list = list_recordings(options.folder);
    ASSERT_EQ(list.size(), 2U);
    EXPECT_EQ(list[0].about.frame_sets, 30U);
    EXPECT_NEAR(list[0].duration_s, 0.3, 1e-9);
    const auto latest = recorder->status().latest;
    ASSERT_TRUE(latest.has_value());
    EXPECT_EQ(read_recording(options.folder, latest->name)->size_bytes, latest->size_bytes);
    EXPECT_TRUE(delete_recording(options.folder, "ffv1").ok());
    EXPECT_TRUE(absl::IsNotFound(delete_recording(options.folder, "ffv1")));
    EXPECT_TRUE(absl::IsInvalidArgument(delete_recording(options.folder, "../x")));
}

TEST_F(RecorderTest, ReadsAnyFrameDirectly) {
    for (const VideoCodec codec : {VideoCodec::kUtVideo, VideoCodec::kH264}) {
        options.codec = codec;
        recorder.reset();
        make();
        const std::string name(name_of(codec));
        ASSERT_TRUE(recorder->start(name, {}).ok());
        offer(0, 120);
        ASSERT_TRUE(recorder->stop().ok());
        const fs::path video = options.folder / name / "left.mkv";
        auto all = RecordedVideo::open(video, fake_cameras()[0]),
             some = RecordedVideo::open(video, fake_cameras()[0]);
        ASSERT_TRUE(all.ok() && some.ok()) << all.status() << some.status();
        std::vector<Image> images;
        for (int n = 0; n < 120; ++n) images.push_back(*(*all)->next());
        for (const int n : {119, 0, 60, 61, 62, 59, 3, 118, 118})
            EXPECT_TRUE(same(*(*some)->read(n), images[static_cast<std::size_t>(n)])) << name << " " << n;
        EXPECT_TRUE(absl::IsOutOfRange((*some)->read(120).status()));
        // H.264 loses little even of noise.
        double difference = 0;
        const Image truth = noise(fake_cameras()[0], 0);
        for (int i = 0; i < 64 * 48 * 3; ++i)
            difference += std::abs(int{images[0].data[i]} - int{truth.data[i]});
        if (codec == VideoCodec::kUtVideo)
            EXPECT_EQ(difference, 0);
        else
            EXPECT_LT(difference / (64 * 48 * 3), 80);
    }
}

TEST_F(RecorderTest, CountsMissingImagesAndGaps) {
    make();
    ASSERT_TRUE(recorder->start("gaps", {}).ok());
    offer(0, 4);
    FrameSet half = noise_set(4);
    half.images[1] = {};
    recorder->offer(half);
    offer(7, 3);  // 5 and 6 never came
    const auto info = recorder->stop();
    ASSERT_TRUE(info.ok()) << info.status();
    EXPECT_EQ(info->about.frame_sets, 8U);
    EXPECT_EQ(info->about.lost_frame_sets, 2U);
    EXPECT_EQ(info->about.missing_images, 1U);
    const auto sets = read_all(session_file("gaps"));
    ASSERT_EQ(sets.size(), 8U);
    EXPECT_TRUE(sets[4].images[1].empty());
    EXPECT_FALSE(sets[4].images[0].empty());
    EXPECT_TRUE(same(sets[5].images[1], noise(fake_cameras()[1], 71)));
    EXPECT_EQ(sets[5].capture_time_ns, 7 * kPeriodNs);
    const auto times = read_recorded_times(options.folder / "gaps" / "frames.csv");
    EXPECT_EQ((*times)[5].sequence, 7U);
    // Times that none was recorded at lead to the nearest frame.
    const auto replay = ReplaySource::open(session_file("gaps"), {.paused = true});
    ASSERT_TRUE(replay.ok()) << replay.status();
    for (const auto& [seconds, frame] :
         {std::pair{0.05, 4}, {0.056, 5}, {0.0, 0}, {0.09, 7}, {0.12, 10}, {-0.02, -2}})
        EXPECT_EQ((*replay)->frame_at(seconds), frame) << seconds;
}

TEST_F(RecorderTest, DropsAndCountsBeyondTheQueue) {
    options.max_queue_bytes = 2 * 2 * 64 * 48 * 3;  // two frame sets
    make();
    ASSERT_TRUE(recorder->start("much", VideoCodec::kFfv1).ok());
    constexpr std::uint64_t kOffered = 400;
    for (std::uint64_t n = 0; n < kOffered; ++n) recorder->offer(noise_set(n));
    offer(kOffered, 1);
    const auto info = recorder->stop();
    ASSERT_TRUE(info.ok()) << info.status();
    EXPECT_GT(info->about.dropped_frame_sets, 0U);
    EXPECT_EQ(info->about.frame_sets + info->about.dropped_frame_sets, kOffered + 1);
    EXPECT_EQ(info->about.lost_frame_sets, 0U);
    EXPECT_EQ(read_all(session_file("much")).size(), info->about.frame_sets);
    EXPECT_EQ(read_session(session_file("much"))->recording->dropped_frame_sets,
              info->about.dropped_frame_sets);
    EXPECT_THAT(event_kinds(), ::testing::Contains(EventKind::kRecordingFramesDropped));
}

TEST_F(RecorderTest, SavesTheBufferAndContinues) {
    options.max_buffer_s = 0.5;
    make();
    EXPECT_TRUE(absl::IsFailedPrecondition(recorder->save_buffer("early", 0, false).status()));
    offer(0, 200);
    wait_until_written();
    EXPECT_NEAR(recorder->status().buffered_s, 0.5, 0.02);
    const auto info = recorder->save_buffer("jump", 0.3, false);
    ASSERT_TRUE(info.ok()) << info.status();
    EXPECT_EQ(info->about.frame_sets, 30U);
    expect_noise_sets(read_all(session_file("jump")), 170, 30);
    const auto all = recorder->save_buffer("all", 1e300, false);
    ASSERT_TRUE(all.ok()) << all.status();
    expect_noise_sets(read_all(session_file("all")), 149, 51);

    const auto going = recorder->save_buffer("jump2", 0, true);
    ASSERT_TRUE(going.ok()) << going.status();
    offer(200, 100);
    const auto end = recorder->stop();
    ASSERT_TRUE(end.ok()) << end.status();
    EXPECT_EQ(end->about.frame_sets, 151U);
    EXPECT_EQ(end->about.lost_frame_sets, 0U);
    expect_noise_sets(read_all(session_file("jump2")), 149, 151);
}

// Subjects 1 and 2; the second is not shown by every third frame set, and leaves.
FrameResult two_subjects(std::uint64_t sequence, const std::shared_ptr<const Volume>& volume) {
    FrameResult result = *testing::fake_result(sequence, volume);
    SubjectResult second = result.subjects.front();
    second.track.subject_id = 2;
    if (sequence % 3 == 0) second.volume.reset(), second.pose.reset();
    if (sequence < 12) result.subjects.push_back(second);
    return result;
}

TEST_F(RecorderTest, RecordsEverySubject) {
    options.several_subjects = true;
    make();
    ASSERT_TRUE(recorder->start("two", {}).ok());
    const auto volume = std::make_shared<const Volume>(testing::person_volume(0.05));
    const BodyShape small = default_body_shape(1.6), tall = default_body_shape(1.9);
    const BodyOf body_of = [&](std::uint32_t id) { return id == 2 ? &tall : &small; };
    for (std::uint64_t n = 0; n < 15; ++n) {
        recorder->offer(noise_set(n));
        recorder->observe(two_subjects(n, volume), body_of);
    }
    ASSERT_TRUE(recorder->stop().ok());
    const fs::path recording = options.folder / "two";

    std::ifstream joints(recording / "poses" / "joints.csv");
    std::string line, rows;
    std::getline(joints, line);
    while (std::getline(joints, line)) {
        const auto subject = line.find(',', line.find(',') + 1);
        rows += line.substr(0, line.find(',')) + ":" + line.substr(subject + 1, 1) +
                (line.find(",,,,") == std::string::npos ? " " : "- ");
    }
    EXPECT_EQ(rows,
              "0:1 0:2- 1:1 1:2 2:1 2:2 3:1 3:2- 4:1 4:2 5:1 5:2 6:1 6:2- 7:1 7:2 8:1 8:2 9:1 9:2- "
              "10:1 10:2 11:1 11:2 12:1 13:1 14:1 ");
    for (const auto& [file, body] : {std::pair{"body_1.toml", small}, std::pair{"body_2.toml", tall}}) {
        const auto written = read_body_shape(recording / "poses" / file);
        ASSERT_TRUE(written.ok()) << written.status();
        EXPECT_NEAR(written->stature_m, body.stature_m, 1e-6) << file;
    }
    const std::atomic<bool> stop = false;
    for (const auto& [subject_id, files, last] :
         {std::tuple{0u, 23u, "000011_s2.ply"}, std::tuple{2u, 8u, "000011.ply"}}) {
        const fs::path out = folder.path() / std::to_string(subject_id);
        fs::create_directory(out);
        const auto exported = export_recording(
            recording, {.format = ExportFormat::kPly, .subject_id = subject_id}, out, {stop});
        ASSERT_TRUE(exported.ok()) << exported.status();
        EXPECT_EQ(exported->files.size(), files);
        EXPECT_TRUE(fs::exists(out / last)) << last;
    }
    EXPECT_FALSE(fs::exists(folder.path() / "0/000009_s2.ply")) << "tracked, but not shown";
    EXPECT_TRUE(absl::IsOutOfRange(
        export_recording(recording, {.format = ExportFormat::kPly, .subject_id = 3}, folder.path(), {stop})
            .status()));
}

TEST_F(RecorderTest, RecordsLatestNamesOfSubjects) {
    options.several_subjects = true;
    make();
    const auto volume = std::make_shared<const Volume>(testing::person_volume(0.05));
    const auto record = [&](const char* name, const auto& name_of) {  // two_subjects() and four
        ASSERT_TRUE(recorder->start(name, {}).ok());
        for (std::uint64_t n = 0; n < 15; ++n) {
            recorder->offer(noise_set(n));
            FrameResult result = two_subjects(n, volume);
            for (const std::uint32_t id : {3u, 4u}) {
                result.subjects.push_back(result.subjects.front());
                result.subjects.back().track.subject_id = id;
            }
            for (SubjectResult& subject : result.subjects)
                subject.track.name = name_of(subject.track.subject_id, n);
            recorder->observe(result, no_body);
        }
        ASSERT_TRUE(recorder->stop().ok());
    };
    record("named", [](std::uint32_t id, std::uint64_t n) -> std::string {
        if (id == 1) return n < 5 ? "" : n < 10 ? "Anna" : "Anna B.";
        if (id == 2) return "Ben, \"the fast\"";  // leaves after frame set 11
        if (id == 3) return n < 10 ? "Cleo" : "";
        return "Anna B.";
    });
    const auto names = read_subject_names(options.folder / "named" / "poses");
    ASSERT_TRUE(names.ok()) << names.status();
    EXPECT_EQ(*names, (SubjectNames{{1, "Anna B."}, {2, "Ben, \"the fast\""}, {4, "Anna B."}}));
    const std::atomic<bool> stop = false;
    const fs::path out = folder.path() / "volumes", anonymous = folder.path() / "anonymous";
    fs::create_directory(out);
    fs::create_directory(anonymous);
    ASSERT_TRUE(export_recording(options.folder / "named", {.format = ExportFormat::kPly}, out, {stop}).ok());
    EXPECT_EQ(read_subject_names(out)->size(), 3U);
    ASSERT_TRUE(export_recording(options.folder / "named", {.format = ExportFormat::kPly, .anonymous = true},
                                 anonymous, {stop})
                    .ok());
    EXPECT_FALSE(fs::exists(anonymous / "subjects.csv"));

    record("unnamed", [](std::uint32_t, std::uint64_t) { return ""; });
    EXPECT_FALSE(fs::exists(options.folder / "unnamed" / "poses" / "subjects.csv"));
}

TEST_F(RecorderTest, WaitsForTheLastPoses) {
    options.save_volumes = false;
    make();
    ASSERT_TRUE(recorder->start("late", {}).ok());
    const auto volume = std::make_shared<const Volume>();
    for (std::uint64_t n = 0; n < 20; ++n) recorder->offer(noise_set(n));
    for (std::uint64_t n = 0; n < 12; ++n) recorder->observe(*testing::fake_result(n, volume), no_body);
    auto stopping = std::async(std::launch::async, [this] { return recorder->stop(); });
    while (recorder->status().state != RecorderState::kFinishing) std::this_thread::yield();
    for (std::uint64_t n = 12; n < 25; ++n)  // and of some that are no longer in it
        recorder->observe(*testing::fake_result(n, volume), no_body);
    ASSERT_TRUE(stopping.get().ok());
    std::ifstream angles(options.folder / "late" / "poses" / "angles.csv");
    std::string line;
    std::getline(angles, line);
    for (int n = 0; n < 20; ++n) {
        ASSERT_TRUE(std::getline(angles, line)) << n;
        EXPECT_THAT(line, ::testing::Not(HasSubstr(",,,,"))) << "a row without its pose";
    }
    EXPECT_FALSE(std::getline(angles, line)) << line;
}

TEST_F(RecorderTest, BufferIsLimitedByMemory) {
    options.max_buffer_s = 10;
    options.max_buffer_bytes = 50 * 2 * 64 * 48 * 3;  // noise cannot be made smaller
    make();
    offer(0, 200);
    wait_until_written();
    EXPECT_TRUE(recorder->status().buffer_limited_by_memory);
    EXPECT_LE(recorder->status().buffered_bytes, options.max_buffer_bytes);
    EXPECT_GT(recorder->status().buffered_s, 0.2);
    EXPECT_LT(recorder->status().buffered_s, 0.6);
}

TEST_F(RecorderTest, StartsAndEndsWithTheCapture) {
    make();
    ASSERT_TRUE(recorder->start("", {}).ok());
    EXPECT_EQ(recorder->status().state, RecorderState::kWaiting);
    EXPECT_TRUE(absl::IsFailedPrecondition(recorder->start("second", {}).status()));
    recorder->capture_ended();  // a start that failed
    offer(0, 10);
    recorder->capture_ended();
    for (int i = 0; i < 2000 && recorder->status().state != RecorderState::kIdle; ++i)
        std::this_thread::sleep_for(2ms);
    ASSERT_TRUE(recorder->status().latest.has_value());
    const RecordingInfo last = *recorder->status().latest;
    EXPECT_EQ(last.about.frame_sets, 10U);
    EXPECT_THAT(last.about.end_reason, HasSubstr("capture ended"));
    EXPECT_TRUE(absl::IsFailedPrecondition(recorder->stop().status()));
    EXPECT_TRUE(absl::IsAlreadyExists(recorder->start(last.name, {}).status()));
    EXPECT_TRUE(absl::IsInvalidArgument(recorder->start("a/b", {}).status()));
    EXPECT_TRUE(recorder->start("again", {}).ok());  // an error before leaves nothing behind
    recorder->close();
}

TEST_F(RecorderTest, FullDiskEndsARecording) {
    options.min_free_bytes = std::uint64_t{1} << 62;
    make();
    const auto refused = recorder->start("full", {});
    EXPECT_TRUE(absl::IsResourceExhausted(refused.status())) << refused.status();
    EXPECT_FALSE(fs::exists(options.folder / "full"));
}

// Truncated anywhere, as by a power failure: complete frame sets are read, and all files get the same length.
TEST_F(RecorderTest, RepairsInterruptedRecordings) {
    make();
    ASSERT_TRUE(recorder->start("whole", {}).ok());
    offer(0, 40);
    ASSERT_TRUE(recorder->stop().ok());
    const fs::path whole = options.folder / "whole";
    const auto index = read_video_index(whole / "left.mkv");
    ASSERT_EQ(index->size(), 40U);
    const auto end = [&](std::size_t frame) { return (*index)[frame].end(); };
    struct Cut {
        const char* file;
        std::uint64_t bytes;
        std::size_t frames;
    };
    const std::vector<Cut> cuts{{"left.mkv", end(20) - 1, 20},
                                {"left.mkv", end(20), 21},
                                {"right.index", kVideoIndexHeader.size() + 32 * 5 + 7, 5},
                                {"frames.csv", 100, 3},
                                {"poses/joints.csv", 0, 40},
                                {"left.mkv", end(39) - 100, 39}};
    for (std::size_t n = 0; n < cuts.size(); ++n) {
        const fs::path copy = options.folder / ("cut" + std::to_string(n));
        fs::copy(whole, copy, fs::copy_options::recursive);
        auto session = read_session(copy / "session.toml");
        session->recording->closed = false;
        ASSERT_TRUE(write_session(*session, copy / "session.toml").ok());
        if (cuts[n].bytes > 0 || std::string(cuts[n].file) == "frames.csv")
            fs::resize_file(copy / cuts[n].file, cuts[n].bytes);
        // The first reader repairs it.
        if (n % 2 == 0) {
            EXPECT_TRUE(ReplaySource::open(copy / "session.toml").ok());
        }
        EXPECT_EQ(read_session(copy / "session.toml")->recording->closed, n % 2 == 0);
        const auto sets = read_all(copy / "session.toml");
        std::size_t frames = cuts[n].frames;
        if (std::string(cuts[n].file) == "frames.csv") frames = sets.size();
        expect_noise_sets(sets, 0, frames);
        EXPECT_GT(sets.size(), 0U);
        const auto repaired = read_session(copy / "session.toml");
        EXPECT_TRUE(repaired->recording->closed && repaired->recording->recovered);
        EXPECT_EQ(repaired->recording->frame_sets, frames);
        EXPECT_EQ(read_video_index(copy / "left.mkv")->size(), frames);
        EXPECT_EQ(read_recorded_times(copy / "frames.csv")->size(), frames);
    }
    EXPECT_FALSE(*repair_recording(whole / "session.toml"));  // was closed
}

TEST_F(RecorderTest, DoesNotRepairWhileWriting) {
    make();
    ASSERT_TRUE(recorder->start("open", {}).ok());
    offer(0, 40);
    wait_until_written();
    const auto now = read_recording(options.folder, "open");
    ASSERT_TRUE(now.ok()) << now.status();
    EXPECT_FALSE(now->about.closed);
    EXPECT_EQ(now->about.frame_sets, 40U);
    EXPECT_FALSE(*repair_recording(session_file("open")));
    EXPECT_TRUE(absl::IsFailedPrecondition(delete_recording(options.folder, "open")));
    expect_noise_sets(read_all(session_file("open")), 0, 40);  // what is there already
    ASSERT_TRUE(recorder->stop().ok());
}

}  // namespace
}  // namespace kinevox
