// What an operator asks about the people in the scene while it is captured: which are followed, what they are
// called. Shared by the pipeline's first half and the API.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/geometry.h"
#include "server/pipeline/tracking/subject_rules.h"

namespace kinevox {

// A person in the scene, or who was in it and has a name or a request.
struct KnownSubject {
    std::uint32_t id = 0;
    std::string name;  // empty: none
    bool present = false;
    Followed followed = Followed::kTooMany;  // as present
    Vec3 centre_in_world;                    // m; the last one
    double height_m = 0;                     // of the highest part above the floor
    double absent_s = 0;
};

// Thread safe.
class SubjectControl {
  public:
    static constexpr std::size_t kMaxNameBytes = 100;

    explicit SubjectControl(int max_subjects) : max_subjects_(max_subjects) {}

    // Everybody who can be named: those present and those remembered, in the order of their ids.
    std::vector<KnownSubject> list() const;

    // NotFound, naming those there are, for an unknown id; InvalidArgument for more than max_subjects or
    // none.
    absl::Status follow_only(const std::vector<std::uint32_t>& ids);
    absl::Status ignore(const std::vector<std::uint32_t>& ids);
    void follow_all();
    // An empty name removes it. InvalidArgument for control characters, more than kMaxNameBytes and a name
    // that another one has.
    absl::Status set_name(std::uint32_t id, const std::string& name);

    // The name of a recorded subject, who may be this one; only once, and not against an operator's choice.
    // Others may have it, too.
    void suggest_name(std::uint32_t id, const std::string& name);

    // For the pipeline.
    SubjectRequests requests() const;
    std::string name_of(std::uint32_t id) const;
    // Those present or remembered now; requests and names of others are forgotten.
    void publish(std::vector<KnownSubject> known);
    void forget();

  private:
    absl::Status check_known(const std::vector<std::uint32_t>& ids) const;

    const int max_subjects_;
    mutable std::mutex mutex_;  // guards the following
    std::vector<KnownSubject> known_;
    SubjectRequests requests_;
    std::map<std::uint32_t, std::string> names_;
    std::set<std::uint32_t> decided_;  // named, suggested or without a name on request
};

}  // namespace kinevox
