#include "server/tools/calibrate/session_measurements.h"

#include <fmt/format.h>

#include <cmath>

#include "common/session_file.h"
#include "server/calibration/person/diagnosis.h"
#include "server/cameras/session_source.h"
#include "server/pipeline/pipeline.h"
#include "server/pose/pose_stage.h"
#include "server/tools/process/pose_pass.h"
#include "server/tools/process/quality_pass.h"

namespace kinevox::calibrate {
namespace {

constexpr std::int64_t kMaxFrameSets = 240;
constexpr double kVoxel_m = 0.02;  // silhouettes and poses do not depend on the voxels' size much
constexpr double kStatureCaution = 0.03, kStatureNoGo = 0.06;

Finding finding_of(const quality::Cause& cause) {
    // The certificate's own codes.
    const std::string check = cause.cause == "floor_height" ? "feet_height" : cause.cause;
    return {cause.trust == quality::Trust::kDoNotUse ? Verdict::kNoGo : Verdict::kCaution, check,
            cause.camera, cause.reason, cause.remedy};
}

std::optional<Finding> compare_stature(double measured_m, double known_m) {
    const double fraction = measured_m / known_m - 1;
    if (std::abs(fraction) <= kStatureCaution) return std::nullopt;
    return Finding{
        std::abs(fraction) > kStatureNoGo ? Verdict::kNoGo : Verdict::kCaution, "scale", "",
        fmt::format("the subject is measured {:.2f} m tall instead of {:.2f} m: all lengths are "
                    "{:.0f} % too {}, as from a wrong square size",
                    measured_m, known_m, 100 * std::abs(fraction), fraction > 0 ? "long" : "short"),
        "measure the board's squares with a ruler and calibrate again with their true size"};
}

}  // namespace

absl::StatusOr<quality::Measurements> measure_session(const std::filesystem::path& session_file,
                                                      const std::vector<Camera>& cameras,
                                                      const SolveProgress& progress) {
    auto source = open_session_source(session_file);
    if (!source.ok()) return source.status();
    const auto background = background_of_all(**source, session_file);
    if (!background.ok()) return background.status();
    PipelineOptions options;
    options.voxel_m = kVoxel_m;
    options.colouring = false;
    options.posing.filtered = false;
    auto pipeline = Pipeline::create(cameras, (*source)->fps(), options);
    if (!pipeline.ok()) return pipeline.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;
    PosePass poses(cameras, (*source)->fps(), options,
                   {.cutoff_hz = 0, .searches = 1});  // enough for stature and floor
    QualityPass quality(session_file, cameras, *background);
    for (std::int64_t n = 0; n < kMaxFrameSets; ++n) {
        auto frame_set = (*source)->next();
        if (absl::IsOutOfRange(frame_set.status())) break;
        if (!frame_set.ok()) return frame_set.status();
        const auto result = (*pipeline)->process(*std::move(frame_set));
        if (!result.ok()) return result.status();
        poses.add(**result, **pipeline);
        quality.add(**result);
        if (progress && !progress(static_cast<double>(n) / kMaxFrameSets, fmt::format("poses, frame {}", n)))
            return absl::CancelledError("stopped; nothing was written");
    }
    const std::vector<PoseRow> rows = poses.finish(**pipeline);
    return quality.measure(&poses, rows).front();
}

std::vector<Finding> findings_of(const quality::Measurements& seen, const std::vector<Camera>& cameras,
                                 std::optional<double> stature_m) {
    std::vector<Finding> findings = check_world(cameras, std::nullopt, std::nullopt);
    if (worst(findings) != Verdict::kNoGo)
        if (const auto cause = quality::judge_world(seen)) findings.push_back(finding_of(*cause));
    for (const auto& judge : {quality::judge_time, quality::judge_intrinsics, quality::judge_camera})
        if (const auto cause = judge(seen)) findings.push_back(finding_of(*cause));
    std::optional<Finding> scale;
    if (stature_m && seen.body.stature_m) scale = compare_stature(*seen.body.stature_m, *stature_m);
    if (!scale)
        if (const auto cause = quality::judge_scale(seen)) scale = finding_of(*cause);
    if (scale) findings.push_back(*std::move(scale));
    return findings;
}

}  // namespace kinevox::calibrate
