#include "client/viewer/plot_marks.h"

#include <fmt/format.h>

#include <utility>

namespace kinevox::viewer {
namespace {

const char* label(v1::EventKind kind) {
    switch (kind) {
        case v1::EVENT_KIND_SUBJECT_FOUND:
            return "found";
        case v1::EVENT_KIND_SUBJECT_LOST:
            return "lost";
        case v1::EVENT_KIND_RECORDING_STARTED:
            return "recording";
        case v1::EVENT_KIND_RECORDING_STOPPED:
        case v1::EVENT_KIND_RECORDING_FAILED:
            return "recording ended";
        case v1::EVENT_KIND_CAMERA_DISCONNECTED:
        case v1::EVENT_KIND_CAMERA_MOVED:
            return "camera";
        default:
            return nullptr;
    }
}

}  // namespace

void PlotMarks::clear() {
    marks_.clear();
    count_ = 0;
}

void PlotMarks::add(PlotMark mark) {
    marks_.push_back(std::move(mark));
    if (marks_.size() > kMaxMarks) marks_.pop_front();
}

void PlotMarks::add_event(v1::EventKind kind, std::int64_t time_ns) {
    if (const char* text = label(kind)) add({time_ns, text, false});
}

int PlotMarks::add_mark(std::int64_t time_ns) {
    add({time_ns, fmt::format("mark {}", ++count_), true});
    return count_;
}

std::vector<PlotMark> PlotMarks::between(std::int64_t first_ns, std::int64_t last_ns) const {
    std::vector<PlotMark> inside;
    for (const PlotMark& mark : marks_)
        if (mark.time_ns >= first_ns && mark.time_ns <= last_ns) inside.push_back(mark);
    return inside;
}

}  // namespace kinevox::viewer
