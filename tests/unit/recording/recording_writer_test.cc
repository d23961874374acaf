// The recorder's writing half on a disk that fails: a recording whose files take no more ends, and nothing
// else does.
#include "server/recording/recording_writer.h"

#include <gtest/gtest.h>

namespace kinevox {
namespace {

// Accepts images, and results as long as there is room.
class FullFolder final : public RecordingFolder {
  public:
    explicit FullFolder(int room) : room_(room) {}
    absl::Status append(const EncodedSet&) override {
        ++about_.frame_sets;
        return absl::OkStatus();
    }
    absl::Status append_result(std::uint64_t, const RecordedResult&) override {
        return room_-- > 0 ? absl::OkStatus() : absl::ResourceExhaustedError("the disk is full");
    }
    absl::Status set_background(const std::vector<std::filesystem::path>&) override {
        return absl::OkStatus();
    }
    absl::Status set_body(const BodyShape&) override { return absl::OkStatus(); }
    absl::Status close(const Ending&) override {
        about_.closed = true;
        return absl::OkStatus();
    }
    const std::filesystem::path& path() const override { return path_; }
    const SessionRecording& about() const override { return about_; }
    RecordingInfo info() const override { return {.name = "full", .about = about_}; }
    int room() const { return room_; }

  private:
    const std::filesystem::path path_ = std::filesystem::temp_directory_path() / "full";
    SessionRecording about_;
    int room_;
};

std::shared_ptr<EncodedSet> set_of(std::uint64_t number) {
    auto set = std::make_shared<EncodedSet>();
    set->number = set->sequence = number;
    set->run = 1;
    set->capture_time_ns = static_cast<std::int64_t>(number) * 10'000'000;
    set->key = true;
    set->images.push_back(std::make_shared<EncodedImage>());
    return set;
}

// The sets wait for their results, which then arrive at once; the second does not fit.
void fill(RecordingWriter& writer) {
    writer.begin(std::make_unique<FullFolder>(1), 0);
    for (std::uint64_t n = 0; n < 4; ++n) writer.take(ResultOfSet{1, n, {}});
    for (std::uint64_t n = 0; n < 4; ++n) writer.take(set_of(n));
}

TEST(RecordingWriter, EndsOnceWhenResultsDoNotFit) {
    for (const double max_buffer_s : {0.0, 10.0}) {
        RecorderOptions options;
        options.max_buffer_s = max_buffer_s;
        options.min_free_bytes = 0;
        std::vector<RecordingInfo> ended;
        RecordingWriter writer(options, [&](const RecordingInfo& info) { ended.push_back(info); });
        fill(writer);
        ASSERT_EQ(ended.size(), 1u) << max_buffer_s;
        EXPECT_EQ(ended[0].about.end_reason, "the disk is full");
        EXPECT_FALSE(writer.recording(0));
        EXPECT_EQ(writer.next_number(), 4u);
        // What comes next belongs to the next recording alone.
        writer.begin(std::make_unique<FullFolder>(100), 4);
        for (std::uint64_t n = 4; n < 8; ++n) {
            writer.take(set_of(n));
            writer.take(ResultOfSet{1, n, {}});
        }
        ASSERT_EQ(ended.size(), 1u);
        EXPECT_EQ(writer.recording(0)->about.frame_sets, 4u);
        EXPECT_TRUE(writer.has_all_results());
        EXPECT_EQ(writer.end(0, "").about.end_reason, "");
    }
}

TEST(RecordingWriter, WaitsForSlowResultsOnly) {
    RecorderOptions options;
    options.min_free_bytes = 0;
    RecordingWriter writer(options, [](const RecordingInfo&) { FAIL() << "ended"; });
    auto made = std::make_unique<FullFolder>(100);
    const FullFolder& folder = *made;
    writer.begin(std::move(made), 0);
    for (std::uint64_t n = 0; n < 3000; ++n) writer.take(set_of(n));  // 30 s
    writer.take(ResultOfSet{1, 0, {}});
    EXPECT_EQ(folder.room(), 99);
    EXPECT_FALSE(writer.has_all_results());
    writer.take(ResultOfSet{1, 2998, {}});  // the pipeline skipped those between
    EXPECT_EQ(folder.room(), 98);
    EXPECT_FALSE(writer.has_all_results());
    writer.take(ResultOfSet{1, 2999, {}});
    EXPECT_TRUE(writer.has_all_results());
    for (std::uint64_t n = 3000; n < 10'000; ++n) writer.take(set_of(n));  // 70 s, and the pipeline hangs
    writer.take(ResultOfSet{1, 3000, {}});
    EXPECT_EQ(folder.room(), 97) << "it is not waited for for ever";
}

}  // namespace
}  // namespace kinevox
