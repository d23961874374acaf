#include "server/recording/recording_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <system_error>
#include <utility>

#include "common/volume_codec.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxWaitingResults = 256;
// An entry that waits for its result is small once its images are written; with images, fewer may wait.
constexpr double kMaxWithoutResult_s = 60, kMaxWithImages_s = 5;
constexpr std::chrono::milliseconds kSpaceCheckInterval{250};

}  // namespace

RecordingWriter::RecordingWriter(const RecorderOptions& options,
                                 std::function<void(const RecordingInfo&)> on_failure)
    : options_(options), on_failure_(std::move(on_failure)) {}

void RecordingWriter::take(std::shared_ptr<const EncodedSet> set) {
    next_number_ = set->number + 1;
    if (set->run != run_) {
        entries_.clear();
        entries_bytes_ = 0;
        limited_by_memory_ = false;
        run_ = set->run;
        awaited_from_ = 0;
    }
    if (!set->status.ok()) {
        if (folder_) fail(set->status);
        return;
    }
    Entry& entry = entries_.emplace_back(Entry{std::move(set), 0, {}, false, {}});
    entry.bytes = entry.set->bytes();
    entries_bytes_ += entry.bytes;
    if (folder_ && entry.set->number >= first_number_) write(entry);
    join_results();
    trim();
}

void RecordingWriter::take(ResultOfSet result) {
    results_.push_back(std::move(result));
    if (results_.size() > kMaxWaitingResults) results_.pop_front();
    join_results();
    trim();
}

// Results come in the order of their sets; the result of a dropped set belongs to no entry.
void RecordingWriter::join_results() {
    const auto too_early = [this](const ResultOfSet& result) {
        return result.run > run_ ||
               (result.run == run_ && (entries_.empty() || result.sequence > entries_.back().set->sequence));
    };
    while (!results_.empty() && !too_early(results_.front())) {
        ResultOfSet result = std::move(results_.front());  // a recording that fails now clears results_
        results_.pop_front();
        if (result.run == run_) awaited_from_ = result.sequence + 1;
        const auto found = std::ranges::lower_bound(entries_, result.sequence, {},
                                                    [](const Entry& entry) { return entry.set->sequence; });
        if (result.run == run_ && found != entries_.end() && found->set->sequence == result.sequence &&
            (found->frame || options_.max_buffer_s > 0)) {
            found->has_result = true;
            for (ResultOfSet::Subject& subject : result.subjects) {
                RecordedSubject& recorded =
                    found->result.subjects.emplace_back(RecordedSubject{subject.id,
                                                                        std::move(subject.name),
                                                                        std::move(subject.pose),
                                                                        std::move(subject.body),
                                                                        {}});
                if (subject.volume && options_.save_volumes) recorded.volume = encode_volume(*subject.volume);
                found->bytes += recorded.volume.size();
                entries_bytes_ += recorded.volume.size();
            }
            if (folder_ && found->frame) check(folder_->append_result(*found->frame, found->result));
        }
    }
}

void RecordingWriter::trim() {
    const double max_wait_s = options_.max_buffer_s > 0 ? kMaxWithImages_s : kMaxWithoutResult_s;
    const auto over = [this, max_wait_s] {
        const Entry& oldest = entries_.front();
        const double age_s =
            1e-9 * static_cast<double>(entries_.back().set->capture_time_ns - oldest.set->capture_time_ns);
        const bool awaited =
            folder_ && oldest.frame && !oldest.has_result && oldest.set->sequence >= awaited_from_;
        if (awaited && age_s < max_wait_s) return false;
        if (options_.max_buffer_s == 0) return true;
        if (age_s > options_.max_buffer_s) return true;
        return entries_bytes_ > options_.max_buffer_bytes && (limited_by_memory_ = true);
    };
    while (!entries_.empty() && over()) {
        entries_bytes_ -= entries_.front().bytes;
        entries_.pop_front();
    }
    if (options_.max_buffer_s > 0) return;
    for (Entry& entry : entries_)  // they only wait for their results
        if (entry.frame && entry.set->bytes() > 0) {
            auto light = std::make_shared<EncodedSet>(*entry.set);
            light->images.clear();
            entries_bytes_ -= entry.set->bytes();
            entry.bytes -= entry.set->bytes();
            entry.set = std::move(light);
        }
}

RecordingWriter::Buffered RecordingWriter::buffered() const {
    if (options_.max_buffer_s == 0 || entries_.empty()) return {};
    const std::int64_t time_ns = entries_.back().set->capture_time_ns - entries_.front().set->capture_time_ns;
    return {1e-9 * static_cast<double>(time_ns), entries_bytes_, limited_by_memory_};
}

void RecordingWriter::set_body(const BodyShape& body) {
    if (folder_) check(folder_->set_body(body));
}

void RecordingWriter::set_background(const std::vector<std::filesystem::path>& videos) {
    if (folder_) check(folder_->set_background(videos));
}

absl::Status RecordingWriter::check_space() {
    const auto now = std::chrono::steady_clock::now();
    if (now - space_checked_ < kSpaceCheckInterval) return absl::OkStatus();
    space_checked_ = now;
    std::error_code error;
    const auto space = std::filesystem::space(path_, error);
    if (error || space.available >= options_.min_free_bytes) return absl::OkStatus();
    return absl::ResourceExhaustedError(
        fmt::format("{} MB are free on the disk of {}, min_free_disk_mb is {}; free some space",
                    space.available >> 20, path_.parent_path().string(), options_.min_free_bytes >> 20));
}

void RecordingWriter::write(Entry& entry) {
    if (absl::Status space = check_space(); !space.ok()) return fail(space);
    if (absl::Status written = folder_->append(*entry.set); !written.ok()) return fail(written);
    entry.frame = folder_->about().frame_sets - 1;
    if (entry.has_result) check(folder_->append_result(*entry.frame, entry.result));
}

void RecordingWriter::begin(std::unique_ptr<RecordingFolder> folder, std::uint64_t first_number) {
    path_ = folder->path();
    folder_ = std::move(folder);
    first_number_ = first_number;
    space_checked_ = {};
    for (Entry& entry : entries_) {
        entry.frame.reset();
        if (folder_ && entry.set->number >= first_number_ && !entry.set->images.empty()) write(entry);
    }
}

void RecordingWriter::begin_with_buffer(std::unique_ptr<RecordingFolder> folder, double duration_s) {
    std::uint64_t first = next_number_;
    for (const Entry& entry : entries_) {
        const auto age_ns =
            static_cast<double>(entries_.back().set->capture_time_ns - entry.set->capture_time_ns);
        if (!entry.set->key || (duration_s > 0 && age_ns >= std::round(1e9 * duration_s))) continue;
        first = entry.set->number;
        break;
    }
    begin(std::move(folder), first);
}

std::optional<RecordingInfo> RecordingWriter::recording(std::uint64_t dropped_sets) const {
    if (!folder_) return std::nullopt;
    RecordingInfo info = folder_->info();
    if (!info.about.closed) {
        info.about.dropped_frame_sets = dropped_sets;
        info.about.lost_frame_sets -=
            std::min(info.about.lost_frame_sets, dropped_sets);  // both are gaps in the sequence
    }
    return info;
}

bool RecordingWriter::has_all_results() const {
    return std::ranges::all_of(entries_, [](const Entry& entry) { return !entry.frame || entry.has_result; });
}

RecordingInfo RecordingWriter::end(std::uint64_t dropped_sets, const std::string& reason) {
    std::string why = reason;
    if (absl::Status closed = folder_->close({dropped_sets, reason}); !closed.ok() && why.empty())
        why = std::string(closed.message());
    RecordingInfo info = *recording(dropped_sets);
    info.about.end_reason = why;
    folder_.reset();
    for (Entry& entry : entries_) entry.frame.reset();
    if (options_.max_buffer_s == 0) results_.clear();
    return info;
}

void RecordingWriter::fail(const absl::Status& why) {
    if (!folder_) return;
    on_failure_(end(dropped, std::string(why.message())));
}

}  // namespace kinevox
