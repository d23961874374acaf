#include "server/pipeline/tracking/subject_memory.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/median.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxRemembered = 64;  // remembered; those that are absent for longest are forgotten
constexpr std::size_t kKeptObservations = 64;
constexpr std::size_t kMinObservations = 4;  // of a person who can be recognised
constexpr float kKeptFraction = 0.97f;       // of the colours' sum per observation

// One sigma of the difference between two visits of a person, beyond the range within one.
constexpr double kColourStd = 0.05, kTopStd_m = 0.05, kVolumeStd_log = 0.25;
constexpr double kUsualChange = 0.1;  // colour distance within one visit, at least
// A stranger is as likely as a person who is this many sigmas off.
constexpr double kStranger = 3;
// A person present who looks the same shows that strangers may, too.
constexpr double kLookalikeWeight = 0.5;

constexpr double kLike_log = -2, kClearly_log = 4;  // likelihoods of a person, and against another place

// A person cannot be elsewhere at once, and who vanishes usually appears near by.
constexpr double kMaxSpeed_m_per_s = 8, kMaxJump_m = 1;
constexpr double kNearSpeed_m_per_s = 1.5, kNear_m = 0.5, kNear_s = 2, kNearBonus = 2;

constexpr double kNanoseconds = 1e-9;

double quantile(std::vector<double> values, double fraction) {
    return quantile_of(values, fraction);
}

// Distance of a value from the usual range.
double beyond(const std::vector<double>& usual, double value) {
    return std::max({0.0, quantile(usual, 0.1) - value, value - quantile(usual, 0.9)});
}

}  // namespace

void add_appearance(Appearance& sum, const Appearance& seen) {
    for (int band = 0; band < kBodyBands; ++band) sum.colours[band].add(seen.colours[band], 1);
    if (seen.top_m <= sum.top_m) return;
    sum.top_m = seen.top_m;
    sum.litres = seen.litres;
}

SubjectMemory::Person* SubjectMemory::find(std::uint32_t subject_id) {
    const auto found = std::ranges::find(people_, subject_id, &Person::id);
    return found == people_.end() ? nullptr : &*found;
}

void SubjectMemory::observe(std::uint32_t subject_id, const Appearance& seen) {
    Person* person = find(subject_id);
    if (!person) {
        if (people_.size() >= kMaxRemembered)
            people_.erase(std::ranges::min_element(people_, {}, &Person::last_seen_ns));
        person = &people_.emplace_back();
        person->id = subject_id;
        person->last_seen_ns = std::numeric_limits<std::int64_t>::min();
    }
    const double change = colour_distance(person->mean, seen);
    for (int band = 0; band < kBodyBands; ++band) {
        person->mean.colours[band].scale(kKeptFraction);
        person->mean.colours[band].add(seen.colours[band], 1);
    }
    const auto keep = [&](std::vector<double>& values, double value) {
        if (values.size() < kKeptObservations)
            values.push_back(value);
        else
            values[person->next % kKeptObservations] = value;
    };
    keep(person->tops_m, seen.top_m);
    keep(person->litres, seen.litres);
    keep(person->changes, std::isfinite(change) ? change : kUsualChange);
    ++person->next;
}

void SubjectMemory::place(std::uint32_t subject_id, std::int64_t time_ns, Vec3 centre_in_world) {
    Person* const person = find(subject_id);
    if (!person) return;
    person->last_seen_ns = time_ns;
    person->last_centre = centre_in_world;
}

std::size_t SubjectMemory::observations(std::uint32_t subject_id) const {
    const auto person = std::ranges::find(people_, subject_id, &Person::id);
    return person == people_.end() ? 0 : person->tops_m.size();
}

bool SubjectMemory::knows_absent(std::span<const std::uint32_t> present, std::int64_t since_ns) const {
    return std::ranges::any_of(people_, [&](const Person& person) {
        return person.tops_m.size() >= kMinObservations && person.last_seen_ns >= since_ns &&
               std::ranges::find(present, person.id) == present.end();
    });
}

std::vector<RememberedSubject> SubjectMemory::remembered() const {
    std::vector<RememberedSubject> all;
    for (const Person& person : people_)
        all.push_back({person.id, person.last_seen_ns, person.last_centre, quantile(person.tops_m, 0.5)});
    return all;
}

double SubjectMemory::log_likelihood(const Person& person, const Appearance& seen) {
    const double distance = colour_distance(person.mean, seen);
    if (!std::isfinite(distance)) return -std::numeric_limits<double>::infinity();
    const double usual = std::max(kUsualChange, quantile(person.changes, 0.9));
    const double colours = std::max(0.0, distance - usual) / kColourStd;
    const double top = beyond(person.tops_m, seen.top_m) / kTopStd_m;
    std::vector<double> logs;
    for (const double litres : person.litres) logs.push_back(std::log(litres));
    const double volume = beyond(logs, std::log(seen.litres)) / kVolumeStd_log;
    return -0.5 * (colours * colours + top * top + volume * volume);
}

bool SubjectMemory::has_strayed(std::uint32_t subject_id, const Appearance& there,
                                const Appearance& newcomer) const {
    const auto person = std::ranges::find(people_, subject_id, &Person::id);
    if (person == people_.end() || person->tops_m.size() < kMinObservations) return false;
    const double like = log_likelihood(*person, newcomer);
    return like > kLike_log && like > log_likelihood(*person, there) + kClearly_log;
}

std::optional<Recognition> SubjectMemory::recognise(const Appearance& seen, Vec3 centre_in_world,
                                                    std::int64_t time_ns,
                                                    std::span<const std::uint32_t> present,
                                                    std::int64_t since_ns) const {
    double others = std::exp(-0.5 * kStranger * kStranger), best = 0;
    Recognition found;
    for (const Person& person : people_) {
        if (person.tops_m.size() < kMinObservations || person.last_seen_ns < since_ns) continue;
        double log_weight = log_likelihood(person, seen);
        if (std::ranges::find(present, person.id) != present.end()) {
            others += kLookalikeWeight * std::exp(log_weight);
            continue;
        }
        const double absent_s = kNanoseconds * static_cast<double>(time_ns - person.last_seen_ns);
        const double distance_m = norm(centre_in_world - person.last_centre);
        if (distance_m > kMaxJump_m + kMaxSpeed_m_per_s * absent_s) continue;
        if (absent_s <= kNear_s && distance_m <= kNear_m + kNearSpeed_m_per_s * absent_s)
            log_weight += kNearBonus;
        const double weight = std::exp(log_weight);
        if (weight > best) {
            others += best;
            best = weight;
            found.subject_id = person.id;
        } else {
            others += weight;
        }
    }
    if (found.subject_id == 0) return std::nullopt;
    found.probability = best / (best + others);
    return found;
}

}  // namespace kinevox
