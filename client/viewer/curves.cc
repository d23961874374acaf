#include "client/viewer/curves.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <utility>

namespace kinevox::viewer {
namespace {

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
constexpr double kMinForRatio_deg = 5;
constexpr std::int64_t kKept_ns = std::int64_t{1'000'000'000} * AngleHistory::kMaxAge_s;

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

void AngleHistory::clear() {
    instants_.clear();
}

void AngleHistory::add(const ShownPose& pose) {
    if (!instants_.empty()) {
        const std::int64_t later_ns = pose.capture_time_ns - instants_.back().time_ns;
        if (later_ns <= 0 || later_ns > kKept_ns) clear();
    }
    Instant instant{pose.capture_time_ns, std::vector<float>(names_.size(), kNothing)};
    for (const ShownAngle& angle : pose.angles) {
        const auto [place, is_new] = index_.try_emplace(angle.name, names_.size());
        if (is_new) {
            names_.push_back(angle.name);
            instant.value_deg.push_back(kNothing);
        }
        if (angle.value_deg) instant.value_deg[place->second] = static_cast<float>(*angle.value_deg);
    }
    instants_.push_back(std::move(instant));
    while (pose.capture_time_ns - instants_.front().time_ns > kKept_ns) instants_.pop_front();
}

AngleHistory::Series AngleHistory::series(const std::string& angle) const {
    Series series;
    const auto place = index_.find(angle);
    if (place == index_.end() || instants_.empty()) return series;
    for (const Instant& instant : instants_) {
        series.time_s.push_back(1e-9 * static_cast<double>(instant.time_ns - instants_.back().time_ns));
        series.value_deg.push_back(place->second < instant.value_deg.size() ? instant.value_deg[place->second]
                                                                            : kNothing);
    }
    return series;
}

std::optional<double> AngleHistory::latest_deg(const std::string& angle) const {
    const auto place = index_.find(angle);
    if (place == index_.end() || instants_.empty() || place->second >= instants_.back().value_deg.size())
        return {};
    const float value = instants_.back().value_deg[place->second];
    return std::isnan(value) ? std::nullopt : std::optional<double>(value);
}

std::optional<std::int64_t> AngleHistory::latest_time_ns() const {
    return instants_.empty() ? std::nullopt : std::optional(instants_.back().time_ns);
}

std::string AngleHistory::opposite_side(const std::string& angle) {
    std::string other = angle;
    if (angle.ends_with("_l"))
        other.back() = 'r';
    else if (angle.ends_with("_r"))
        other.back() = 'l';
    else
        return {};
    return other;
}

std::optional<double> AngleHistory::left_over_right(const std::string& angle) const {
    const std::string other = opposite_side(angle);
    if (other.empty()) return {};
    const bool is_left = angle.ends_with("_l");
    const auto left = latest_deg(is_left ? angle : other), right = latest_deg(is_left ? other : angle);
    if (!left || !right || std::abs(*right) < kMinForRatio_deg) return {};
    return *left / *right;
}

void PlotMarks::clear() {
    marks_.clear();
    count_ = 0;
}

void PlotMarks::add(PlotMark mark) {
    marks_.push_back(std::move(mark));
    if (marks_.size() > kMaxMarks) marks_.pop_front();
}

void PlotMarks::add_event(v1::EventKind kind, std::int64_t time_ns, std::uint32_t subject_id) {
    if (const char* text = label(kind)) add({time_ns, text, false, subject_id});
}

int PlotMarks::add_mark(std::int64_t time_ns) {
    add({time_ns, fmt::format("mark {}", ++count_), true, 0});
    return count_;
}

std::vector<PlotMark> PlotMarks::between(std::int64_t first_ns, std::int64_t last_ns) const {
    std::vector<PlotMark> inside;
    for (const PlotMark& mark : marks_)
        if (mark.time_ns >= first_ns && mark.time_ns <= last_ns) inside.push_back(mark);
    return inside;
}

}  // namespace kinevox::viewer
