// Lost and found: time until volume and pose are back after a second without usable images.
//   lost_and_found SESSION.toml... [--database] [--timed] [--undisturbed]
// Each session needs truth/joints.csv and runs through the pipeline as in the daemon, once per event:
//   blocked     the background for a second, then the subject where the movement has arrived meanwhile
//   black       black images for a second (covered cameras, lights out)
//   white       white images for a second
//   silent      no images for a second
//   one black   one camera's images stay black from then on
//   leaves      the subject is gone for three seconds and returns elsewhere, in another pose
// "Back" is the first of three consecutive frame sets with a volume, or with a mean joint error below 100 mm;
// the time counts from the first image that shows the subject again. Fails beyond 0.5 s, or if a body is
// reported while there is none. The longest frame set, in which the body is searched, counts with --timed
// only: on a shared machine it means little. With --database a pose database is built first and proposes
// poses, as in the daemon. With --undisturbed each session also runs without events, and the table has the
// errors of the same frame sets in that run.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>

#include "server/cameras/session_source.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/pipeline.h"
#include "server/pose/database/database_builder.h"
#include "server/pose/database/database_search.h"
#include "server/pose/pose_stage.h"
#include "tests/accuracy/true_joints.h"

namespace kinevox {
namespace {

constexpr double kBound_s = 0.5, kMaxError_m = 0.1;
constexpr int kInARow = 3;
constexpr double kBefore_s = 1.0;  // of undisturbed movement
constexpr double kAfter_s = 1.0;   // twice the bound

struct Event {
    const char* name;
    double lasts_s;
    bool movement_continues;  // while it lasts; else it is cut out
    double cut_s;             // additionally, of the movement
    // The images meanwhile.
    std::function<Image(std::size_t camera, const Image& shown, const Image& empty)> instead;
    bool for_ever = false;
    bool subject_hidden = true;  // while it lasts
};

Image plain(const Image& like, std::uint8_t grey) {
    const std::size_t bytes = static_cast<std::size_t>(like.width) * like.height * like.channels;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::fill_n(data.get(), bytes, grey);
    return {like.width, like.height, like.channels, data};
}

std::vector<Event> events() {
    const auto empty = [](std::size_t, const Image&, const Image& scene) { return scene; };
    const auto grey = [](std::uint8_t value) {
        return [value](std::size_t, const Image& shown, const Image&) { return plain(shown, value); };
    };
    return {{"blocked", 1, true, 0, empty},
            {"black", 1, true, 0, grey(0)},
            {"white", 1, true, 0, grey(255)},
            {"silent", 1, true, 0, [](std::size_t, const Image&, const Image&) { return Image(); }},
            {"one black", 1, true, 0,
             [](std::size_t camera, const Image& shown, const Image&) {
                 return camera == 0 ? plain(shown, 0) : shown;
             },
             true, false},
            {"leaves", 3, false, 1, empty}};
}

std::optional<double> error_of(const FrameResult& result, const testing::TrueJoints& truth) {
    const SubjectResult* const subject = result.first_subject();
    if (!subject || !subject->pose) return std::nullopt;
    double sum = 0;
    int count = 0;
    for (std::size_t j = 0; j < truth.size(); ++j) {
        if (!subject->pose->joints[j].measured()) continue;
        sum += norm(subject->pose->joints[j].in_world - truth[j]);
        ++count;
    }
    if (count < static_cast<int>(truth.size()) / 2) return std::nullopt;
    return sum / count;
}

// Seconds until `good` was true kInARow times; nullopt: never.
std::optional<double> back_after(const std::vector<bool>& good, double fps) {
    for (std::size_t n = 0; n + kInARow <= good.size(); ++n)
        if (std::all_of(good.begin() + static_cast<std::ptrdiff_t>(n),
                        good.begin() + static_cast<std::ptrdiff_t>(n) + kInARow, [](bool g) { return g; }))
            return static_cast<double>(n) / fps;
    return std::nullopt;
}

std::string seconds_text(const std::optional<double>& seconds) {
    return seconds ? fmt::format("{:.2f}", *seconds) : std::string("never");
}

// Mean joint errors by frame, m.
using Errors = std::map<int, double>;

// One event in one session; true if within the bound. Without an event the whole session runs and fills
// `undisturbed`.
absl::StatusOr<bool> play(const std::filesystem::path& session_file, const Event* event_or_none,
                          const std::map<int, testing::TrueJoints>& truth, PoseProposer* proposer, bool timed,
                          Errors& undisturbed) {
    static const Event kNone{"none", 0, true, 0, {}};
    const Event& event = event_or_none ? *event_or_none : kNone;
    auto source = open_session_source(session_file);
    if (!source.ok()) return source.status();
    PipelineOptions options;
    auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), options);
    if (!pipeline.ok()) return pipeline.status();
    auto background = (*source)->background();
    if (!background.ok()) return background.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;
    (*pipeline)->pose_stage()->set_proposer(proposer);

    const double fps = (*source)->fps();
    const std::int64_t before = event_or_none ? static_cast<std::int64_t>(kBefore_s * fps)
                                              : std::numeric_limits<std::int64_t>::max() / 2;
    const auto lasts = static_cast<std::int64_t>(std::ceil(event.lasts_s * fps));
    const auto cut = static_cast<std::int64_t>(event.cut_s * fps);
    std::vector<bool> volumes, poses;
    std::vector<double> errors_undisturbed, errors_after;  // of the same frames
    int invented = 0;                                      // poses reported while no subject is visible
    double max_ms = 0;                                     // of a frame set's processing afterwards
    std::vector<std::string> story;
    std::uint64_t sequence = 0;
    int frame = -1;
    FrameSet last;
    // One frame set through the pipeline. `phase`: 0 before, 1 during, 2 after the event.
    const auto show = [&](const FrameSet& shown, int phase) -> absl::Status {
        FrameSet set = shown;
        set.sequence = sequence;
        set.capture_time_ns = static_cast<std::int64_t>(1e9 * static_cast<double>(sequence) / fps);
        ++sequence;
        if (phase == 1 || (phase == 2 && event.for_ever))
            for (std::size_t c = 0; c < set.images.size(); ++c) {
                const auto& scene = (*background)[c];
                set.images[c] = event.instead(c, set.images[c], scene[sequence % scene.size()]);
            }
        auto result = (*pipeline)->process(std::move(set));
        if (!result.ok()) return result.status();
        const auto known = truth.find(frame);
        const auto error = known == truth.end() ? std::nullopt : error_of(**result, known->second);
        const SubjectResult* const subject = (*result)->first_subject();
        const bool has_volume = subject && subject->volume;
        invented += phase == 1 && event.subject_hidden && subject && subject->pose;
        if (phase == 2) {
            max_ms = std::max(max_ms, (*result)->times.total_ms);
            volumes.push_back(has_volume);
            poses.push_back(error && *error < kMaxError_m);
            story.push_back(!has_volume ? "-" : error ? fmt::format("{:.0f}", 1000 * *error) : "v");
        }
        if (error && !event_or_none) undisturbed[frame] = *error;
        if (error && phase == 2) {
            errors_after.push_back(*error);
            if (const auto usual = undisturbed.find(frame); usual != undisturbed.end())
                errors_undisturbed.push_back(usual->second);
        }
        return absl::OkStatus();
    };
    for (std::int64_t step = 0;; ++step) {
        const int phase = step < before ? 0 : step < before + lasts ? 1 : 2;
        if (phase != 1 || event.movement_continues) {
            for (std::int64_t skip = step == before + lasts ? cut : 0; skip >= 0; --skip) {
                auto next = (*source)->next();
                if (absl::IsOutOfRange(next.status())) {
                    frame = -1;
                    break;
                }
                if (!next.ok()) return next.status();
                frame = static_cast<int>(next->sequence);
                last = *std::move(next);
            }
            if (frame < 0) break;
        }
        if (absl::Status status = show(last, phase); !status.ok()) return status;
        if (phase == 2 && volumes.size() >= static_cast<std::size_t>(kAfter_s * fps)) break;
    }
    if (!event_or_none) return true;
    const auto mean_text = [](const std::vector<double>& values) {
        double sum = 0;
        for (const double value : values) sum += value;
        return values.empty() ? std::string("-")
                              : fmt::format("{:.0f}", 1000 * sum / static_cast<double>(values.size()));
    };
    const auto volume = back_after(volumes, fps), pose = back_after(poses, fps);
    if (volumes.size() < kInARow) {
        fmt::print("| {} | {} | the recording is too short | | | | | | |\n",
                   session_file.parent_path().filename().string(), event.name);
        return true;
    }
    const double search_s = timed ? 1e-3 * max_ms : 0;
    const bool good = volume && pose && std::max(*volume, *pose) + search_s <= kBound_s && invented == 0;
    fmt::print("| {} | {} | {} | {} | {:.0f} | {} | {} | {} | {} |\n",
               session_file.parent_path().filename().string(), event.name, seconds_text(volume),
               seconds_text(pose), max_ms, invented, mean_text(errors_undisturbed), mean_text(errors_after),
               good ? "ok" : "FAILS");
    if (!good) {
        fmt::print(stderr,
                   "{} {}: mm per frame set afterwards (-: no volume, v: no pose):", session_file.string(),
                   event.name);
        for (std::size_t n = 0; n < std::min<std::size_t>(story.size(), 40); ++n)
            fmt::print(stderr, " {}", story[n]);
        fmt::print(stderr, "\n");
    }
    std::fflush(stdout);
    return good;
}

absl::StatusOr<bool> run(const std::filesystem::path& session_file, bool with_database, bool timed,
                         bool with_undisturbed) {
    const auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    const auto truth = testing::read_true_joints(session->truth / "joints.csv");
    if (truth.empty())
        return absl::NotFoundError(
            fmt::format("{}: no true joints; give a session with truth", session_file.string()));
    std::optional<PoseDatabase> database;
    std::optional<DatabaseSearch> search;
    if (with_database) {
        const auto cameras = read_session_cameras(*session);
        if (!cameras.ok()) return cameras.status();
        std::vector<kernels::CameraModel> models;
        for (const Camera& camera : *cameras) models.push_back(to_kernel(camera));
        PoseDatabaseOptions options;
        options.threads = 2;
        auto built = build_pose_database(models, default_body_shape(), options);
        if (!built.ok()) return built.status();
        database = *std::move(built);
        search.emplace(*database, SearchOptions());
    }
    bool good = true;
    Errors undisturbed;
    PoseProposer* const proposer = search ? &*search : nullptr;
    if (with_undisturbed) {
        const auto all = play(session_file, nullptr, truth, proposer, timed, undisturbed);
        if (!all.ok()) return all.status();
    }
    for (const Event& event : events()) {
        const auto played = play(session_file, &event, truth, proposer, timed, undisturbed);
        if (!played.ok()) return played.status();
        good = *played && good;
    }
    return good;
}

}  // namespace
}  // namespace kinevox

int main(int argc, char** argv) {
    kinevox::silence_video_libraries();
    bool with_database = false, timed = false, with_undisturbed = false, good = true;
    std::vector<std::filesystem::path> sessions;
    for (int n = 1; n < argc; ++n)
        if (!std::strcmp(argv[n], "--database"))
            with_database = true;
        else if (!std::strcmp(argv[n], "--timed"))
            timed = true;
        else if (!std::strcmp(argv[n], "--undisturbed"))
            with_undisturbed = true;
        else
            sessions.emplace_back(argv[n]);
    if (sessions.empty())
        return std::fprintf(stderr,
                            "usage: lost_and_found SESSION.toml... [--database] [--timed] [--undisturbed]\n"),
               1;
    fmt::print(
        "| session | event | volume back, s | pose back, s | longest frame set, ms | poses meanwhile | mm "
        "undisturbed | mm after "
        "| |\n| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |\n");
    for (const auto& session : sessions) {
        if (!std::filesystem::exists(session)) {
            fmt::print("{} is not here; set KINEVOX_TEST_DATA to the folder that holds the test data\n",
                       session.string());
            return 77;
        }
        const auto result = kinevox::run(session, with_database, timed, with_undisturbed);
        if (!result.ok())
            return std::fprintf(stderr, "%s\n", std::string(result.status().message()).c_str()), 1;
        good = *result && good;
    }
    return good ? 0 : 1;
}
