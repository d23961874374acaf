#include "server/calibration/solved_certificate.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "server/calibration/diagnosis.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kSamePlace_m = 0.05;   // cameras that were not touched are found again within this
constexpr double kMovedPlace_m = 0.30;  // beyond it they do not tell where the old floor was

void move_world(const Alignment& new_from_old, ExtrinsicsResult& result) {
    move_cameras(new_from_old, result.cameras);
    for (Vec3& point : result.seen_points) point = new_from_old(point);
}

// The mean over the frames before and after in which the board lay as still as it can be measured.
Rigid3 resting_pose(const std::map<int, Rigid3>& poses, std::map<int, Rigid3>::const_iterator lying) {
    constexpr double kStill_m = 0.01, kStillTurn = 0.02;  // rad
    const auto rests = [&](const Rigid3& pose) {
        return norm(pose.translation - lying->second.translation) < kStill_m &&
               angle_between(pose.rotation, lying->second.rotation) < kStillTurn;
    };
    auto first = lying, end = std::next(lying);
    while (first != poses.begin() && rests(std::prev(first)->second)) --first;
    while (end != poses.end() && rests(end->second)) ++end;
    Vec3 shift, turn;  // against `lying`, both small
    const double part = 1.0 / static_cast<double>(std::distance(first, end));
    for (auto pose = first; pose != end; ++pose) {
        const Rigid3 difference = lying->second.inverse() * pose->second;
        shift += part * difference.translation;
        turn += part * rodrigues_from_rotation(difference.rotation);
    }
    return lying->second * Rigid3{rotation_from_rodrigues(turn), shift};
}

}  // namespace

absl::Status set_world_by_board(std::span<const int> lying, ExtrinsicsResult& result) {
    for (const int moment : lying) {
        const auto found = result.world_from_board.find(moment);
        if (found == result.world_from_board.end()) continue;
        move_world({1, resting_pose(result.world_from_board, found).inverse()}, result);
        return absl::OkStatus();
    }
    return absl::FailedPreconditionError(
        "two cameras did not see the board together while it lay on the floor; put it where two or more see "
        "all of it");
}

bool take_over_world(const std::vector<Camera>& like, ExtrinsicsResult& result) {
    std::vector<Vec3> from, to;
    for (const Camera& camera : result.cameras)
        if (const Camera* const there = camera_named(like, camera.name)) {
            from.push_back(camera.centre_in_world());
            to.push_back(there->centre_in_world());
        }
    const auto like_from_solved = from.size() < 3 ? std::nullopt : align_points(from, to, false);
    if (!like_from_solved) return false;
    double farthest = 0;
    for (std::size_t i = 0; i < from.size(); ++i)
        farthest = std::max(farthest, norm((*like_from_solved)(from[i]) - to[i]));
    if (farthest > kMovedPlace_m) return false;
    move_world(*like_from_solved, result);
    const bool same = farthest <= kSamePlace_m;
    result.findings.push_back(
        {same ? Verdict::kGo : Verdict::kCare, "world", "",
         fmt::format(
             "floor and origin are those of the calibration in use; the cameras lie up to {:.0f} mm from "
             "where it has them",
             1000 * farthest),
         same ? "" : "show the board lying on the floor to set the world anew"});
    return true;
}

Certificate lens_certificate(std::vector<IntrinsicsResult> lenses) {
    Certificate certificate;
    certificate.made_by = "board";
    for (const IntrinsicsResult& lens : lenses) {
        certificate.cameras.push_back(lens.camera);
        certificate.findings.insert(certificate.findings.end(), lens.findings.begin(), lens.findings.end());
    }
    certificate.lenses = std::move(lenses);
    return certificate;
}

Certificate place_certificate(const std::string& made_by, ExtrinsicsResult result, bool world_is_set) {
    Certificate certificate;
    certificate.made_by = made_by;
    certificate.world_is_set = world_is_set;
    if (world_is_set) certificate.findings = check_world(result.cameras, std::nullopt, std::nullopt);
    certificate.volume = volume_coverage(result.cameras, result.seen_points, {}, {});
    certificate.seen_points = some_points(result.seen_points);
    certificate.cameras = std::move(result.cameras);
    certificate.quality = std::move(result.quality);
    certificate.fit_rms_px = result.fit_rms_px;
    certificate.held_out_rms_px = result.held_out_rms_px;
    certificate.scale = result.scale;
    certificate.findings.insert(certificate.findings.end(), result.findings.begin(), result.findings.end());
    return certificate;
}

}  // namespace kinevox
