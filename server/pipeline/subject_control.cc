#include "server/pipeline/subject_control.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <utility>

namespace kinevox {
namespace {

bool is_plain(const std::string& name) {
    return std::ranges::none_of(name,
                                [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

}  // namespace

std::vector<KnownSubject> SubjectControl::list() const {
    const std::lock_guard lock(mutex_);
    std::vector<KnownSubject> all = known_;
    for (KnownSubject& each : all)
        if (const auto name = names_.find(each.id); name != names_.end()) each.name = name->second;
    return all;
}

// Under the lock.
absl::Status SubjectControl::check_known(const std::vector<std::uint32_t>& ids) const {
    if (ids.empty()) return absl::InvalidArgumentError("no subject is given; give one id or more");
    std::vector<std::uint32_t> there;
    for (const KnownSubject& each : known_) there.push_back(each.id);
    for (const std::uint32_t id : ids)
        if (!has_id(there, id))
            return absl::NotFoundError(
                there.empty()
                    ? fmt::format("there is no subject {}; the scene has been empty so far", id)
                    : fmt::format("there is no subject {}; choose one of {}", id, fmt::join(there, ", ")));
    return absl::OkStatus();
}

absl::Status SubjectControl::follow_only(const std::vector<std::uint32_t>& ids) {
    const std::lock_guard lock(mutex_);
    if (absl::Status known = check_known(ids); !known.ok()) return known;
    const std::set<std::uint32_t> distinct(ids.begin(), ids.end());
    if (distinct.size() > static_cast<std::size_t>(max_subjects_))
        return absl::InvalidArgumentError(
            fmt::format("{} subjects are given, but tracking.max_subjects is {}; give fewer, or raise it",
                        distinct.size(), max_subjects_));
    requests_.only.assign(distinct.begin(), distinct.end());
    std::erase_if(requests_.ignored, [&](std::uint32_t id) { return distinct.contains(id); });
    return absl::OkStatus();
}

absl::Status SubjectControl::ignore(const std::vector<std::uint32_t>& ids) {
    const std::lock_guard lock(mutex_);
    if (absl::Status known = check_known(ids); !known.ok()) return known;
    std::vector<std::uint32_t> left = requests_.only;
    std::erase_if(left, [&](std::uint32_t id) { return has_id(ids, id); });
    if (left.empty() && !requests_.only.empty())
        return absl::FailedPreconditionError(
            "no other subject is followed on request; follow another one, or all (kinevox subjects follow "
            "--all)");
    requests_.only = std::move(left);
    for (const std::uint32_t id : ids)
        if (!has_id(requests_.ignored, id)) requests_.ignored.push_back(id);
    return absl::OkStatus();
}

void SubjectControl::follow_all() {
    const std::lock_guard lock(mutex_);
    requests_ = {};
}

absl::Status SubjectControl::set_name(std::uint32_t id, const std::string& name) {
    const std::lock_guard lock(mutex_);
    if (absl::Status known = check_known({id}); !known.ok()) return known;
    if (name.size() > kMaxNameBytes || !is_plain(name))
        return absl::InvalidArgumentError(
            fmt::format("the name has {} bytes; at most {} without control characters are allowed",
                        name.size(), kMaxNameBytes));
    if (name.empty()) {
        decided_.insert(id);
        names_.erase(id);
        return absl::OkStatus();
    }
    for (const auto& [other, taken] : names_)
        if (other != id && taken == name)
            return absl::InvalidArgumentError(
                fmt::format("subject {} has the name '{}' already; choose another one", other, name));
    decided_.insert(id);
    names_[id] = name;
    return absl::OkStatus();
}

void SubjectControl::suggest_name(std::uint32_t id, const std::string& name) {
    const std::lock_guard lock(mutex_);
    if (!check_known({id}).ok() || !decided_.insert(id).second) return;
    names_[id] = name;
}

SubjectRequests SubjectControl::requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
}

std::string SubjectControl::name_of(std::uint32_t id) const {
    const std::lock_guard lock(mutex_);
    const auto found = names_.find(id);
    return found == names_.end() ? std::string() : found->second;
}

void SubjectControl::publish(std::vector<KnownSubject> known) {
    const std::lock_guard lock(mutex_);
    known_ = std::move(known);
    const auto gone = [&](std::uint32_t id) {
        return std::ranges::find(known_, id, &KnownSubject::id) == known_.end();
    };
    std::erase_if(names_, [&](const auto& each) { return gone(each.first); });
    std::erase_if(decided_, gone);
    std::erase_if(requests_.ignored, gone);
    // While one of them is remembered, no other is followed: they may return.
    std::erase_if(requests_.only, gone);
}

void SubjectControl::forget() {
    const std::lock_guard lock(mutex_);
    known_.clear();
    requests_ = {};
    names_.clear();
    decided_.clear();
}

}  // namespace kinevox
