// Recognises people who return: remembers body size and colours of every subject, and compares who appears
// with those who are not in the scene.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/pipeline/tracking/appearance.h"

namespace kinevox {

struct Recognition {
    std::uint32_t subject_id = 0;
    double probability = 0;  // that it is this subject and no other person, 0..1
};

struct RememberedSubject {
    std::uint32_t subject_id = 0;
    std::int64_t last_seen_ns = 0;
    Vec3 last_centre;     // m, world
    double height_m = 0;  // median of its highest part above the floor
};

// Not thread safe.
class SubjectMemory {
  public:
    // Below the first a subject is not recognised; above the second, more frame sets may decide.
    static constexpr double kMinProbability = 0.9, kMinPossible = 0.2;

    // A subject that stands apart from others. Several times per second; not every frame set is needed.
    void observe(std::uint32_t subject_id, const Appearance& seen);
    // Where a subject was seen last.
    void place(std::uint32_t subject_id, std::int64_t time_ns, Vec3 centre_in_world);

    // Number of the latest observations that are kept of a subject.
    std::size_t observations(std::uint32_t subject_id) const;

    // Whether any person but `present` is remembered who was seen after this time.
    bool knows_absent(std::span<const std::uint32_t> present, std::int64_t since_ns) const;
    // Who of those remembered since then, but not `present`, appears here. Empty without any candidate.
    // `seen`: the sum of one or more frame sets, as observe() adds them.
    std::optional<Recognition> recognise(const Appearance& seen, Vec3 centre_in_world, std::int64_t time_ns,
                                         std::span<const std::uint32_t> present, std::int64_t since_ns) const;
    // Whether `there`, where a subject is tracked, does not look like it, but `newcomer` clearly does.
    bool has_strayed(std::uint32_t subject_id, const Appearance& there, const Appearance& newcomer) const;
    std::vector<RememberedSubject> remembered() const;
    void forget() { people_.clear(); }

  private:
    struct Person {
        std::uint32_t id = 0;
        Appearance mean;              // decaying sum of the colours
        std::vector<double> tops_m;   // of the latest observations, as are
        std::vector<double> litres;   // the volumes and
        std::vector<double> changes;  // the colour distances from those before
        std::size_t next = 0;         // to be replaced
        std::int64_t last_seen_ns = 0;
        Vec3 last_centre;
    };
    Person* find(std::uint32_t subject_id);
    static double log_likelihood(const Person& person, const Appearance& seen);

    std::vector<Person> people_;
};

// Adds the colours of a further frame set; size from the taller one.
void add_appearance(Appearance& sum, const Appearance& seen);

}  // namespace kinevox
