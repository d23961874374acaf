#include "server/daemon/replayed_names.h"

#include <spdlog/spdlog.h>

#include <string>
#include <utility>

namespace kinevox {
namespace {

constexpr int kMinFrames = 3;  // near a recorded subject

RecordedNames names_of(const std::filesystem::path& session_file) {
    auto names = RecordedNames::of_session(session_file);
    if (names.ok()) return *std::move(names);
    spdlog::warn("the replayed subjects have no names: {}", std::string(names.status().message()));
    return {};
}

}  // namespace

void ReplayedNames::open(const std::filesystem::path& session_file) {
    RecordedNames recorded = names_of(session_file);
    const std::scoped_lock lock(mutex_);
    recorded_ = std::move(recorded);
    latest_sequence_ = 0;
}

void ReplayedNames::close() {
    const std::scoped_lock lock(mutex_);
    recorded_ = {};
}

void ReplayedNames::observe(const FrameResult& result, SubjectControl& control) {
    const std::scoped_lock lock(mutex_);
    if (recorded_.empty() || !result.frame_set.recorded_frame) return;
    if (result.sequence < latest_sequence_) recorded_.forget();  // started again, with ids from 1
    latest_sequence_ = result.sequence;
    for (const SubjectResult& subject : result.subjects) {
        const std::uint32_t id = subject.track.subject_id;
        recorded_.add(*result.frame_set.recorded_frame, id, subject.track.centre_in_world);
        if (const std::string name = recorded_.name_of(id, kMinFrames); !name.empty())
            control.suggest_name(id, name);
    }
}

}  // namespace kinevox
