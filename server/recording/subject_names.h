// Names of the subjects of pose tables: subjects.csv next to them, and whom they belong to in a repeated run.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

// By id, of those who have one. Two may have the same.
using SubjectNames = std::map<std::uint32_t, std::string>;

inline constexpr std::string_view kSubjectNamesFile = "subjects.csv";

// An empty name removes it.
void set_subject_name(SubjectNames& names, std::uint32_t id, const std::string& name);

// Empty: none.
std::string subject_name(const SubjectNames& names, std::uint32_t id);
// The one that all of `ids` have; empty: none, or different ones.
std::string common_subject_name(const SubjectNames& names, const std::set<std::uint32_t>& ids);

// subject,name: one row per name.
std::string subject_names_csv(const SubjectNames& names);

// Empty without the file. InvalidArgument names file and line.
absl::StatusOr<SubjectNames> read_subject_names(const std::filesystem::path& tables);

// "s2_Anna" or "s2": part of a file name, on every file system and different for each id.
std::string subject_file_name(std::uint32_t id, std::string_view name);

// The names of a recording for the subjects of a repeated run of the pipeline, which may number them
// differently: they are identified by their positions. Not thread safe.
class RecordedNames {
  public:
    // `tables`: the recording's. No names: its subjects have none.
    static absl::StatusOr<RecordedNames> read(const std::filesystem::path& tables);
    // Of the recording with this session.toml. No names: another session, or one without poses.
    static absl::StatusOr<RecordedNames> of_session(const std::filesystem::path& session_file);

    bool empty() const { return names_.empty(); }
    // A subject of the repeated run. `frame`: of the recording.
    void add(std::int64_t frame, std::uint32_t id, const Vec3& centre_in_world);
    // Of the recorded subject who was nearest in most frames; empty: none, or fewer than `min_frames`.
    std::string name_of(std::uint32_t id, int min_frames = 1) const;
    // Those who were added, not the names.
    void forget() { votes_.clear(); }
    // Of all that were added.
    SubjectNames names() const;

  private:
    struct Recorded {
        std::uint32_t id = 0;
        Vec3 centre_in_world;  // m, mean of the joints
    };
    SubjectNames names_;
    std::map<std::int64_t, std::vector<Recorded>> frames_;
    std::map<std::uint32_t, std::map<std::uint32_t, int>> votes_;  // frames, by own id and recorded id
};

}  // namespace kinevox
