#include "tests/support/posed_trial.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <vector>

#include "common/files.h"
#include "server/pose/pose_estimate.h"
#include "server/recording/csv_tables.h"

namespace kinevox::testing {

BodyCoordinates posed_coordinates(int frame) {
    BodyCoordinates q{};
    const double t = frame / kPosedTrialFps;
    for (int d = 0; d < kBodyDofCount; ++d) q[d] = 0.3 * std::sin(5 * t + 0.7 * d) + 0.1;
    q[0] = 1 + 0.9 * t, q[1] = -0.5 + 0.2 * t, q[2] = 0.95 + 0.03 * std::sin(9 * t);
    q[kDofRootRotation + 2] = 2.2 + 3 * t;  // through 180 deg
    for (const int knee : {kDofKneeL, kDofKneeR}) q[knee] = 0.8 + 0.6 * std::sin(5 * t + knee);
    for (const int elbow : {kDofElbowL, kDofElbowR}) q[elbow] = 0.6 + 0.4 * std::sin(5 * t + elbow);
    for (const int arm : {kDofShoulderL, kDofShoulderR}) q[arm] = 1.2 + 1.1 * std::sin(4 * t + arm);
    return q;
}

absl::Status write_posed_trial(const std::filesystem::path& folder, bool gaps) {
    const BodyModel model(default_body_shape(1.8));
    std::vector<PoseRow> rows;
    for (int n = 0; n < kPosedTrialFrames; ++n) {
        PoseRow& row = rows.emplace_back();
        row.frame = n;
        row.time_s = n / kPosedTrialFps;
        if (gaps && n >= 10 && n <= 12) continue;
        row.subject_id = 1;
        auto pose = std::make_shared<BodyPose>();
        if (gaps && n == 20)
            pose->joints[*joint_index("hand_r")].withheld_reason = "joint not visible in any of 4 cameras";
        describe_posture(model, posture_from_coordinates(posed_coordinates(n)), *pose);
        row.pose = pose;
    }
    for (const Table& table : pose_tables(rows))
        if (absl::Status written = write_file_atomically(folder / table.file_name, table.text); !written.ok())
            return written;
    return write_body_shape(model.shape(), folder / "body.toml");
}

absl::Status write_posed_people(const std::filesystem::path& folder, int count, const SubjectNames& names) {
    std::vector<BodyModel> models;
    for (int n = 0; n < count; ++n) models.emplace_back(default_body_shape(1.6 + 0.1 * n));
    std::vector<PoseRow> rows;
    for (int n = 0; n < kPosedTrialFrames; ++n) {
        const PoseRow row{.frame = static_cast<std::uint64_t>(n), .time_s = n / kPosedTrialFps};
        if (count == 0) rows.push_back(row);
        for (int person = 0; person < count; ++person) {
            BodyCoordinates q = posed_coordinates(n);
            q[1] += 1.5 * person;
            auto pose = std::make_shared<BodyPose>();
            describe_posture(models[static_cast<std::size_t>(person)], posture_from_coordinates(q), *pose);
            PoseRow& own = rows.emplace_back(row);
            own.subject_id = static_cast<std::uint32_t>(person + 1);
            own.pose = std::move(pose);
        }
    }
    std::vector<Table> tables = pose_tables(rows);
    if (!names.empty()) tables.push_back({std::string(kSubjectNamesFile), subject_names_csv(names)});
    for (int n = 0; n < count; ++n) {
        const std::string body = body_shape_toml(models[static_cast<std::size_t>(n)].shape());
        tables.push_back({fmt::format("body_{}.toml", n + 1), body});
        if (n == 0) tables.push_back({"body.toml", body});
    }
    for (const Table& table : tables)
        if (absl::Status written = write_file_atomically(folder / table.file_name, table.text); !written.ok())
            return written;
    return absl::OkStatus();
}

}  // namespace kinevox::testing
