// The published method alone: poses from the database, without refinement, against a sequence's true joints.
//   retrieval SESSION.toml SILHOUETTES [--stature METRES | --body FILE] [--step FRAMES] [--poses N]
// SILHOUETTES/CAMERA/000000.png as `kinevox process --save silhouettes` leaves them, or the truth's own
// masks. The centre is where the rays through the silhouettes' middles meet; the body is of average
// proportions for the stature or a body.toml. Prints per rule the error of the nearest entry, of the best
// among the eight nearest (what a refinement may start from), and of the best fit among refinements of those
// eight, each frame set alone (no tracking); mean joint error, median and 90th percentile over the frames;
// and the median times. pose_methods.py runs it on all sequences.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <optional>

#include "common/session_file.h"
#include "common/stopwatch.h"
#include "server/pipeline/convert.h"
#include "server/pose/database/database_builder.h"
#include "server/pose/database/database_search.h"
#include "server/pose/key_poses.h"
#include "server/pose/pose_fitter.h"
#include "server/pose/silhouette_rays.h"
#include "tests/accuracy/true_joints.h"

namespace kinevox {
namespace {

using Joints = testing::TrueJoints;

// Nearest to the rays through the silhouettes' middles.
Vec3 meeting_point(const std::vector<Camera>& cameras, const std::vector<kernels::Silhouettes>& silhouettes) {
    Mat3 a{{0, 0, 0, 0, 0, 0, 0, 0, 0}};
    Vec3 b;
    for (std::size_t n = 0; n < cameras.size(); ++n) {
        if (silhouettes[n].sharp_pixels == 0) continue;
        const Ray ray = cameras[n].ray_through({silhouettes[n].centroid_x, silhouettes[n].centroid_y});
        const Vec3 d = ray.direction_in_world;
        const Mat3 across{{1 - d.x * d.x, -d.x * d.y, -d.x * d.z, -d.y * d.x, 1 - d.y * d.y, -d.y * d.z,
                           -d.z * d.x, -d.z * d.y, 1 - d.z * d.z}};
        for (int k = 0; k < 9; ++k) a.m[k] += across.m[k];
        b += across * ray.origin_in_world;
    }
    const Vec3 c0{a(0, 0), a(1, 0), a(2, 0)}, c1{a(0, 1), a(1, 1), a(2, 1)}, c2{a(0, 2), a(1, 2), a(2, 2)};
    const double det = dot(c0, cross(c1, c2));
    return {dot(b, cross(c1, c2)) / det, dot(c0, cross(b, c2)) / det, dot(c0, cross(c1, b)) / det};
}

kernels::Silhouettes read_silhouette(const std::filesystem::path& file) {
    kernels::Silhouettes out;
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) return out;
    out.width = image.cols, out.height = image.rows;
    out.sharp.assign(static_cast<std::size_t>(out.width) * out.height, 0);
    out.bounds = {out.width, out.height, 0, 0};
    for (int y = 0; y < out.height; ++y)
        for (int x = 0; x < out.width; ++x) {
            if (image.at<std::uint8_t>(y, x) < 128) continue;
            out.sharp[static_cast<std::size_t>(y) * out.width + x] = 255;
            out.centroid_x += x, out.centroid_y += y, ++out.sharp_pixels;
            out.bounds = {std::min(out.bounds.x0, x), std::min(out.bounds.y0, y),
                          std::max(out.bounds.x1, x + 1), std::max(out.bounds.y1, y + 1)};
        }
    out.centroid_x /= std::max<double>(1, static_cast<double>(out.sharp_pixels));
    out.centroid_y /= std::max<double>(1, static_cast<double>(out.sharp_pixels));
    return out;
}

double mean_error(const BodyModel& model, const BodyPosture& pose, const Joints& truth) {
    const auto joints = model.forward(pose).joints_in_world;
    double sum = 0;
    for (std::size_t n = 0; n < joints.size(); ++n) sum += norm(joints[n] - truth[n]);
    return 1000 * sum / static_cast<double>(joints.size());
}

double mean_error(const BodyModel& model, const BodyCoordinates& pose, const Joints& truth) {
    return mean_error(model, posture_from_coordinates(pose), truth);
}

// The candidates moved to the centre and fitted: the one that explains the silhouettes best.
BodyPosture refined(const BodyModel& model, const std::vector<Camera>& cameras,
                    const std::vector<kernels::Silhouettes>& silhouettes,
                    std::span<const PoseCandidate> candidates, Vec3 centre) {
    std::vector<SilhouetteRays> rays(cameras.size());
    for (std::size_t n = 0; n < cameras.size(); ++n) read_silhouette(cameras[n], silhouettes[n], {}, rays[n]);
    PoseFitter fitter;
    std::optional<PoseFit> best;
    for (const PoseCandidate& candidate : candidates) {
        const BodyPosture start = posture_from_coordinates(centred(model, candidate.coordinates, centre));
        PoseFit fit = fitter.fit(model, rays, start, nullptr, true);
        if (!best || fit.at.cost < best->at.cost) best = std::move(fit);
    }
    return best->posture;
}

double quantile(std::vector<double> values, double part) {
    std::sort(values.begin(), values.end());
    return values.empty() ? 0
                          : values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

int run(const std::filesystem::path& session_file, const std::filesystem::path& folder,
        const BodyShape& shape, int step, int poses) {
    const auto session = read_session(session_file);
    if (!session.ok())
        return std::fprintf(stderr, "%s\n", std::string(session.status().message()).c_str()), 1;
    const auto cameras = read_session_cameras(*session);
    if (!cameras.ok())
        return std::fprintf(stderr, "%s\n", std::string(cameras.status().message()).c_str()), 1;
    std::vector<kernels::CameraModel> models;
    for (const Camera& camera : *cameras) models.push_back(to_kernel(camera));
    const auto truth = testing::read_true_joints(session->truth / "joints.csv");
    PoseDatabaseOptions options;
    options.threads = 2;
    options.poses = poses;
    const auto database = build_pose_database(models, shape, options);
    if (!database.ok())
        return std::fprintf(stderr, "%s\n", std::string(database.status().message()).c_str()), 1;
    const BodyModel model(database->shape);
    std::printf(
        "%s, %lld entries, %zu viewpoints\n| rule | error, mm | 90 %%, mm | best of 8, mm | 90 %%, mm | "
        "refined, mm | 90 %%, mm | distance | retrieval, ms | refinement, ms |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n",
        session->name.c_str(), static_cast<long long>(database->entry_count()), database->slabs.size());
    for (const auto& [name, rule] : {std::pair{"published, n = 1000", RetrievalRule::kPublished},
                                     std::pair{"all entries", RetrievalRule::kAll}}) {
        DatabaseSearch search(*database, {.rule = rule});
        std::vector<double> errors, best, fitted, ms, fit_ms, distances;
        for (const auto& [frame, joints] : truth) {
            if (frame % step != 0) continue;
            std::vector<kernels::Silhouettes> silhouettes;
            for (const Camera& camera : *cameras)
                silhouettes.push_back(
                    read_silhouette(folder / camera.name / fmt::format("{:06d}.png", frame)));
            std::vector<PoseView> views;
            for (std::size_t n = 0; n < models.size(); ++n)
                views.push_back({&models[n], silhouettes[n].sharp_pixels > 0 ? &silhouettes[n] : nullptr});
            const Vec3 centre = meeting_point(*cameras, silhouettes);
            const Stopwatch retrieving;
            const auto found = search.propose(views, centre, 8);
            ms.push_back(retrieving.ms());
            if (found.empty()) continue;
            errors.push_back(mean_error(model, found[0].coordinates, joints));
            double least = 1e9;
            for (const PoseCandidate& one : found)
                least = std::min(least, mean_error(model, one.coordinates, joints));
            best.push_back(least);
            const Stopwatch fitting;
            const BodyPosture fit = refined(model, *cameras, silhouettes, found, centre);
            fit_ms.push_back(fitting.ms());
            fitted.push_back(mean_error(model, fit, joints));
            distances.push_back(found[0].distance);
            if (std::getenv("KINEVOX_VERBOSE") && rule == RetrievalRule::kAll)
                std::printf("%d: %.0f mm, '%s', distance %.3f\n", frame, errors.back(),
                            database->poses[search.find(1)[0].pose].label.c_str(), found[0].distance);
        }
        std::printf("| %s | %.0f | %.0f | %.0f | %.0f | %.0f | %.0f | %.3f | %.2f | %.2f |\n", name,
                    quantile(errors, 0.5), quantile(errors, 0.9), quantile(best, 0.5), quantile(best, 0.9),
                    quantile(fitted, 0.5), quantile(fitted, 0.9), quantile(distances, 0.5), quantile(ms, 0.5),
                    quantile(fit_ms, 0.5));
    }
    return 0;
}

}  // namespace
}  // namespace kinevox

int main(int argc, char** argv) {
    kinevox::BodyShape shape = kinevox::default_body_shape(1.75);
    int step = 5, poses = 1400;
    if (argc < 3)
        return std::fprintf(stderr,
                            "usage: retrieval SESSION.toml SILHOUETTES [--stature M | --body FILE] [--step "
                            "N] [--poses N]\n"),
               1;
    for (int n = 3; n + 1 < argc; n += 2) {
        if (!std::strcmp(argv[n], "--stature")) shape = kinevox::default_body_shape(std::atof(argv[n + 1]));
        if (!std::strcmp(argv[n], "--body")) {
            const auto body = kinevox::read_body_shape(argv[n + 1]);
            if (!body.ok())
                return std::fprintf(stderr, "%s\n", std::string(body.status().message()).c_str()), 1;
            shape = *body;
        }
        if (!std::strcmp(argv[n], "--step")) step = std::max(1, std::atoi(argv[n + 1]));
        if (!std::strcmp(argv[n], "--poses")) poses = std::max(1, std::atoi(argv[n + 1]));
    }
    return kinevox::run(argv[1], argv[2], shape, step, poses);
}
