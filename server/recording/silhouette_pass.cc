#include "server/recording/silhouette_pass.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <memory>
#include <utility>

#include "server/cameras/session_source.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {
namespace {

absl::Status run(const Session& session, std::int64_t frame_sets,
                 const std::function<absl::Status(const FrameResult&)>& take, const JobControl& work) {
    const auto source = open_session_source(session);
    if (!source.ok()) return source.status();
    const auto background = background_of_all(**source, session.name);
    if (!background.ok())
        return absl::FailedPreconditionError(
            fmt::format("silhouettes require a background: {}", std::string(background.status().message())));
    PipelineOptions options;  // with colours: the volume of a frame is the prior of the next
    options.pose = false;
    const auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), options);
    if (!pipeline.ok()) return pipeline.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;
    for (std::int64_t n = 0; n < frame_sets; ++n) {
        if (work.stop) return absl::CancelledError("the export was stopped");
        auto frame_set = (*source)->next();
        if (absl::IsOutOfRange(frame_set.status()))
            return absl::DataLossError(
                fmt::format("session \"{}\" has {} frame sets, but poses of {}; rerun `kinevox process`",
                            session.name, n, frame_sets));
        if (!frame_set.ok()) return frame_set.status();
        const auto result = (*pipeline)->process(*std::move(frame_set));
        if (!result.ok()) return result.status();
        if (absl::Status taken = take(**result); !taken.ok()) return taken;
        work.report(static_cast<double>(n + 1) / static_cast<double>(frame_sets));
    }
    return absl::OkStatus();
}

}  // namespace

absl::Status find_silhouettes(const Session& session, const SilhouettePassOptions& options,
                              const std::function<absl::Status(const FrameResult&)>& take,
                              const JobControl& work) {
    if (!options.one_thread) return run(session, options.frame_sets, take, work);
    oneapi::tbb::task_arena arena(1);
    return arena.execute([&] { return run(session, options.frame_sets, take, work); });
}

}  // namespace kinevox
