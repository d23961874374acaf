#include "server/tools/process/run_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "common/files.h"
#include "common/median.h"
#include "common/session_file.h"
#include "common/toml_reader.h"
#include "server/pose/body_shape.h"
#include "server/pose/posture_filter.h"
#include "server/tools/process/process.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kEdgeBytes =
    1 << 20;  // hashed of each file's beginning and end; videos are too long to read

// FNV-1a, 64 bits: detects changes, not forgery.
class Fingerprint {
  public:
    void add(std::string_view bytes) {
        for (const char c : bytes) hash_ = (hash_ ^ static_cast<unsigned char>(c)) * 0x100000001b3ull;
        hash_ = (hash_ ^ 0xff) * 0x100000001b3ull;  // end of a part
    }
    template <typename Number>
    void add_number(Number number) {
        add(fmt::format("{}", number));
    }
    // A file, or all files of a folder; a missing one counts as "missing".
    void add_file(const fs::path& file) {
        std::error_code error;
        if (fs::is_directory(file, error)) {
            std::vector<fs::path> inside;
            for (const auto& entry : fs::directory_iterator(file, error)) inside.push_back(entry.path());
            std::ranges::sort(inside);
            for (const fs::path& each : inside) {
                add(each.filename().string());
                add_edges(each);
            }
            return;
        }
        add_edges(file);
    }
    std::string text() const { return fmt::format("{:016x}", hash_); }

  private:
    void add_edges(const fs::path& file) {
        std::error_code error;
        if (!fs::is_regular_file(file, error)) return add("missing");  // opening a pipe would block
        std::ifstream in(file, std::ios::binary | std::ios::ate);
        if (!in) return add("missing");
        const std::streamoff bytes = in.tellg();
        add_number(bytes);
        std::string edge(kEdgeBytes, '\0');
        for (const std::streamoff from :
             {std::streamoff{0},
              std::max<std::streamoff>(0, bytes - static_cast<std::streamoff>(kEdgeBytes))}) {
            in.clear();
            in.seekg(from);
            in.read(edge.data(), static_cast<std::streamsize>(edge.size()));
            add(std::string_view(edge.data(), static_cast<std::size_t>(in.gcount())));
        }
    }

    std::uint64_t hash_ = 0xcbf29ce484222325ull;
};

absl::Status add_session(const fs::path& file, Fingerprint& fingerprint) {
    const auto session = read_session(file);
    if (!session.ok()) return session.status();
    fingerprint.add_number(session->fps);
    fingerprint.add_file(session->calibration);
    for (const SessionCamera& camera : session->cameras) {
        fingerprint.add(camera.name);
        fingerprint.add_number(camera.offset_s.value_or(0));
        fingerprint.add_file(camera.video);
        if (!camera.background.empty()) fingerprint.add_file(camera.background);
    }
    if (session->recording) fingerprint.add_file(file.parent_path() / "frames.csv");
    return absl::OkStatus();
}

void add_rules(const SubjectRules& rules, Fingerprint& fingerprint) {
    fingerprint.add_number(rules.point.x);
    fingerprint.add_number(rules.point.y);
    for (const auto* regions : {&rules.capture_regions, &rules.keep_out_regions}) {
        fingerprint.add_number(regions->size());
        for (const FloorRegion& region : *regions) {
            fingerprint.add_number(region.corners.size());
            for (const Vec2 corner : region.corners) {
                fingerprint.add_number(corner.x);
                fingerprint.add_number(corner.y);
            }
        }
    }
}

}  // namespace

absl::StatusOr<std::string> run_fingerprint(const ProcessOptions& options) {
    Fingerprint fingerprint;
    fingerprint.add(KINEVOX_VERSION);
    if (absl::Status added = add_session(options.session_file, fingerprint); !added.ok()) return added;
    const PipelineOptions& pipeline = options.pipeline;
    fingerprint.add_number(static_cast<int>(pipeline.device.is_cuda()));  // all GPUs give the same bits
    fingerprint.add_number(pipeline.voxel_m);
    fingerprint.add_number(pipeline.colouring);
    fingerprint.add_number(pipeline.pose);
    visit_option_tables(pipeline, [&](const char* table, const auto& part) {
        fingerprint.add(table);
        visit_options(part, [&](const kernels::OptionInfo& info, const auto& value) {
            fingerprint.add(info.key);
            if constexpr (std::is_enum_v<std::remove_cvref_t<decltype(value)>>)
                fingerprint.add_number(static_cast<int>(value));
            else
                fingerprint.add_number(value);
        });
    });
    add_rules(pipeline.tracker.rules, fingerprint);
    fingerprint.add(body_shape_toml(pipeline.posing.body));
    fingerprint.add_number(options.poses.fit_body);
    fingerprint.add_number(options.poses.cutoff_hz);
    fingerprint.add_number(options.every);
    fingerprint.add_number(options.max_frames);
    fingerprint.add_number(options.single_run);
    fingerprint.add_number(options.writer.save_silhouettes);
    fingerprint.add_number(options.writer.save_volumes);
    fingerprint.add_number(options.writer.save_hulls);
    if (!options.tpose_file.empty() && pipeline.pose)
        if (absl::Status added = add_session(options.tpose_file, fingerprint); !added.ok()) return added;
    return fingerprint.text();
}

std::string run_toml(const ProcessOptions& options, const std::string& fingerprint, double fps,
                     std::int64_t frames) {
    std::error_code error;
    const auto session = fs::absolute(options.session_file, error).lexically_normal();
    std::string text = "# How `kinevox process` computed the files in this folder.\n";
    text +=
        fmt::format("session = {}\n", toml_quoted(error ? options.session_file.string() : session.string()));
    text += fmt::format("fps = {}\nframe_count = {}\n", toml_number(fps), frames);
    text += fmt::format("voxel_mm = {}\n", toml_number(1000 * options.pipeline.voxel_m));
    text += fmt::format("colouring = {}\npose = {}\n", options.pipeline.colouring, options.pipeline.pose);
    text += fmt::format("loose_threshold = {}\n", options.pipeline.segmentation.loose_threshold);
    text +=
        fmt::format("judge_faint = {}   # also set where the silhouettes seemed to lack parts without it\n",
                    options.pipeline.segmentation.judge_faint);
    text += fmt::format("filter_cutoff_hz = {}   # zero-phase low-pass of the poses; 0: off\n",
                        toml_number(applied_cutoff_hz(options.poses.cutoff_hz, fps)));
    text += fmt::format("fingerprint = \"{}\"   # of input, options and program; --resume compares it\n",
                        fingerprint);
    if (const auto read = read_session(options.session_file); read.ok() && has_offsets(*read)) {
        text += "\n[first_image_index]   # per camera: index in its video of the image of frame 0\n";
        const std::vector<std::int64_t> first = first_image_indices(*read);
        for (std::size_t c = 0; c < first.size(); ++c)
            text += fmt::format("{} = {}\n", toml_quoted(read->cameras[c].name), first[c]);
    }
    return text;
}

bool holds_results_of(const fs::path& folder, const std::string& fingerprint) {
    const auto text = read_file(folder / "run.toml");
    return text.ok() && text->find(fmt::format("\nfingerprint = \"{}\"", fingerprint)) != std::string::npos;
}

ProgressBar::ProgressBar(std::int64_t total, bool quiet) : total_(total), line_(quiet) {}

void ProgressBar::show(std::int64_t done) {
    if (!line_.due()) return;
    const double seconds = running_.seconds();
    const double rate = static_cast<double>(done) / std::max(seconds, 1e-6);
    if (total_ <= 0) {
        line_.draw(fmt::format("{} frame sets, {:.0f} per second", done, rate));
    } else {
        constexpr int kWidth = 40;
        const int filled = static_cast<int>(std::min<std::int64_t>(kWidth, kWidth * done / total_));
        const double left_s = static_cast<double>(total_ - done) / std::max(rate, 1e-6);
        line_.draw(fmt::format("[{}{}] {}/{}  {:.0f} per second, {:.0f} s left", std::string(filled, '='),
                               std::string(kWidth - filled, ' '), done, total_, rate, left_s));
    }
}

void RunSummary::add(const FrameResult& result) {
    times_.push_back(result.times);
    for (const SubjectResult& subject : result.subjects)
        if (subject.volume) litres_.push_back(volume_litres(*subject.volume));
}

std::string RunSummary::text(double wall_s) const {
    struct Row {
        const char* name;
        double StageTimes::*value;
    };
    static constexpr std::array kRows{Row{"segmentation", &StageTimes::segmentation_ms},
                                      Row{"tracking", &StageTimes::tracking_ms},
                                      Row{"hull", &StageTimes::hull_ms},
                                      Row{"colouring", &StageTimes::colouring_ms},
                                      Row{"pose", &StageTimes::pose_ms},
                                      Row{"total", &StageTimes::total_ms},
                                      Row{"(decoding)", &StageTimes::decode_ms}};
    std::string out =
        fmt::format("{} frame sets in {:.1f} s ({:.1f} per second), {} with a volume\n", frames(), wall_s,
                    static_cast<double>(frames()) / std::max(wall_s, 1e-9), litres_.size());
    if (!litres_.empty()) {
        const auto [low, high] = std::ranges::minmax(litres_);
        std::vector<double> litres = litres_;
        out += fmt::format("volume {:.1f} to {:.1f} litres, median {:.1f}\n", low, high, median_of(litres));
    }
    out += fmt::format("{:<14}{:>10}{:>10}\n", "ms", "median", "p99");
    for (const Row& row : kRows) {
        std::vector<double> values;
        for (const StageTimes& times : times_) values.push_back(times.*row.value);
        const auto quantile = [&](double fraction) {
            return values.empty() ? std::numeric_limits<double>::quiet_NaN() : quantile_of(values, fraction);
        };
        out += fmt::format("{:<14}{:>10.3f}{:>10.3f}\n", row.name, quantile(0.5), quantile(0.99));
    }
    return out;
}

}  // namespace kinevox
