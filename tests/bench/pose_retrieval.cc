// Retrieval from the pose database: how often each rule finds the true nearest entry, how far the pose is
// off, how long it takes; how long building takes and how large the file is.
//   pose_retrieval [--poses 1400] [--queries 200]
// Queries are poses that the database does not hold, anywhere in a room, seen by four cameras of 640 x 480
// px. "All moments" compares every entry with everything: what it finds is the true nearest. HNSW (where
// hnswlib is installed) indexes records put together for the query's place, which a person who moves would
// need again at every position; its building is not counted.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <numbers>
#include <vector>

#include "server/pose/database/database_builder.h"
#include "server/pose/database/database_file.h"
#include "server/pose/database/database_search.h"
#include "tests/support/database_queries.h"

#ifdef KINEVOX_HAVE_HNSWLIB
#include <hnswlib/hnswlib.h>
#endif

namespace kinevox {
namespace {

double now_ms() {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

double quantile(std::vector<double> values, double part) {
    std::sort(values.begin(), values.end());
    return values.empty() ? NAN
                          : values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

struct Query {
    BodyCoordinates truth;
    RenderedFrame frame;
};

struct Row {
    std::string name;
    int exact = 0, queries = 0;  // the true nearest entry
    std::vector<double> distance_ratio, error_m, ms, look_ms;
};

void print(const Row& row) {
    std::printf("| %s | %.1f | %.3f | %.0f | %.0f | %.2f | %.2f | %.2f |\n", row.name.c_str(),
                100.0 * row.exact / row.queries, quantile(row.distance_ratio, 0.5),
                1000 * quantile(row.error_m, 0.5), 1000 * quantile(row.error_m, 0.9), quantile(row.ms, 0.25),
                quantile(row.ms, 0.5), quantile(row.look_ms, 0.5));
    std::fflush(stdout);
}

int run(int poses, int query_count) {
    const std::vector<kernels::CameraModel> cameras = room_cameras();
    const BodyShape shape = default_body_shape();
    const BodyModel model(shape);
    PoseDatabaseOptions options;
    options.poses = poses;
    options.threads = 2;
    double begin = now_ms();
    auto built = build_pose_database(cameras, shape, options);
    if (!built.ok()) return std::fprintf(stderr, "%s\n", std::string(built.status().message()).c_str()), 1;
    const PoseDatabase& database = *built;
    std::printf("%lld entries (%d poses, %zu viewpoints) built in %.1f s on two threads",
                static_cast<long long>(database.entry_count()), database.pose_count(), database.slabs.size(),
                1e-3 * (now_ms() - begin));
    const auto file = std::filesystem::temp_directory_path() / "kinevox_pose_retrieval.kvxposes";
    if (!write_pose_database(database, file).ok()) return 1;
    begin = now_ms();
    if (!read_pose_database(file).ok()) return 1;
    std::printf("; file of %.0f MB, read in %.2f s\n\n",
                1e-6 * static_cast<double>(std::filesystem::file_size(file)), 1e-3 * (now_ms() - begin));
    std::filesystem::remove(file);

    std::vector<Query> queries;
    for (int n = 0; n < query_count; ++n) {
        Query query{unseen_pose(n), {}};
        query.truth[0] = 1.5 * std::sin(1.7 * n), query.truth[1] = 1.5 * std::cos(2.3 * n),
        query.truth[2] = 0.95;
        query.truth[kDofRootRotation + 2] = 2.399 * n;
        query.frame = render_frame(model, query.truth, cameras);
        queries.push_back(std::move(query));
    }
    std::vector<FoundPose> nearest;
    std::vector<std::vector<FoundPose>> all(queries.size());
    std::printf(
        "| rule | true nearest, %% | distance / least | error, mm | 90 %%, mm | ms, lower quartile | ms, "
        "median | of these moments |\n"
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
    const auto measure = [&](const std::string& name, const SearchOptions& search_options) {
        DatabaseSearch search(database, search_options);
        Row row{name};
        for (std::size_t n = 0; n < queries.size(); ++n) {
            const auto views = queries[n].frame.views(cameras);
            const double from = now_ms();
            search.describe(views, queries[n].frame.centre_in_world);
            const double looked = now_ms();
            row.look_ms.push_back(looked - from);
            const std::vector<FoundPose> found = search.find(8);
            const PoseCandidate candidate = search.place(found[0]);
            row.ms.push_back(now_ms() - from);
            if (search_options.rule == RetrievalRule::kExhaustive) nearest.push_back(found[0]);
            ++row.queries;
            row.exact += found[0].pose == nearest[n].pose && found[0].heading == nearest[n].heading;
            row.distance_ratio.push_back(found[0].distance / nearest[n].distance);
            row.error_m.push_back(mean_joint_distance(model, candidate.coordinates, queries[n].truth));
        }
        print(row);
    };
    measure("all moments of all entries", {.rule = RetrievalRule::kExhaustive});
    measure("published: first moment, n = 1000", {.rule = RetrievalRule::kPublished});
    measure("published: first moment, n = 10000",
            {.rule = RetrievalRule::kPublished, .neighbourhood = 10000});
    for (const int reranked : {20, 60, 160, 500})
        measure("codes of all entries, best " + std::to_string(reranked) + " by all moments",
                {.reranked = reranked});

#ifdef KINEVOX_HAVE_HNSWLIB
    // Records of one place, the room's middle.
    const int values = database.values(), dims = 4 * values;
    const auto record = [&](int pose, int heading, float* out) {
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const AimedView view = aimed_view(camera_centre(cameras[c]), {0, 0, 0.95},
                                              database.half_width_m(), database.options.side_px);
            const int slab = database.nearest_slab(view.elevation, view.distance_m);
            double place = -view.azimuth * kernels::kViewBins / (2 * std::numbers::pi) + 0.5 * heading;
            place -= std::floor(place / kernels::kViewBins) * kernels::kViewBins;
            const int a = static_cast<int>(place) % kernels::kViewBins, b = (a + 1) % kernels::kViewBins;
            const float share = static_cast<float>(place - std::floor(place));
            const std::int16_t* from = database.slabs[slab].moments.data() +
                                       static_cast<std::size_t>(pose) * kernels::kViewBins * values;
            for (int v = 0; v < values; ++v)
                out[c * values + v] = database.moment_step *
                                      ((1 - share) * from[a * values + v] + share * from[b * values + v]);
        }
    };
    hnswlib::L2Space space(dims);
    begin = now_ms();
    hnswlib::HierarchicalNSW<float> index(&space, static_cast<std::size_t>(database.entry_count()), 16, 100);
    std::vector<float> one(dims);
    for (int n = 0; n < database.entry_count(); ++n) {
        record(n / kernels::kHeadings, n % kernels::kHeadings, one.data());
        index.addPoint(one.data(), n);
    }
    const double build_s = 1e-3 * (now_ms() - begin);
    auto calculator = kernels::make_moment_calculator(kernels::Device::kCpu, {.order = options.order});
    std::vector<float> scale(values);
    kernels::moment_orthonormal_scale(options.order, scale.data());
    std::vector<std::vector<float>> asked;
    std::vector<std::pair<int, int>> truth;
    DatabaseSearch reference(database, {.rule = RetrievalRule::kExhaustive});
    for (int n = 0; n < std::min(query_count, 100); ++n) {
        BodyCoordinates q = queries[n].truth;
        q[0] = q[1] = 0;
        RenderedFrame frame = render_frame(model, q, cameras);
        frame.centre_in_world = {0, 0, 0.95};
        reference.describe(frame.views(cameras), frame.centre_in_world);
        const FoundPose found = reference.find(1)[0];
        truth.emplace_back(found.pose, found.heading);
        std::vector<float>& vector = asked.emplace_back(dims);
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const AimedView view = aimed_view(camera_centre(cameras[c]), frame.centre_in_world,
                                              database.half_width_m(), options.side_px);
            AimedSilhouette aimed;
            rectify_silhouette(cameras[c], frame.silhouettes[c].sharp.data(), frame.silhouettes[c].bounds,
                               view, aimed);
            const kernels::MomentView to_describe{
                aimed.mask.data(), options.side_px, aimed.bounds, {}, 0.5f * options.side_px};
            std::vector<kernels::SilhouetteMoments> described;
            calculator->compute(std::span(&to_describe, 1), described);
            for (int v = 0; v < values; ++v) vector[c * values + v] = described[0].values[v] * scale[v];
        }
    }
    std::printf(
        "\nHNSW, %d numbers a record, index built in %.0f s; the search alone, without moments:\n"
        "| ef | true nearest, %% | ms, median |\n| ---: | ---: | ---: |\n",
        dims, build_s);
    for (const int ef : {10, 50, 200}) {
        index.setEf(ef);
        int exact = 0;
        std::vector<double> ms;
        for (std::size_t n = 0; n < asked.size(); ++n) {
            const double from = now_ms();
            const auto found = index.searchKnn(asked[n].data(), 1);
            ms.push_back(now_ms() - from);
            exact +=
                static_cast<int>(found.top().second) == truth[n].first * kernels::kHeadings + truth[n].second;
        }
        std::printf("| %d | %.1f | %.2f |\n", ef, 100.0 * exact / static_cast<double>(asked.size()),
                    quantile(ms, 0.5));
    }
#endif
    return 0;
}

}  // namespace
}  // namespace kinevox

int main(int argc, char** argv) {
    int poses = 1400, queries = 200;
    for (int n = 1; n + 1 < argc; n += 2) {
        if (!std::strcmp(argv[n], "--poses")) poses = std::atoi(argv[n + 1]);
        if (!std::strcmp(argv[n], "--queries")) queries = std::atoi(argv[n + 1]);
    }
    return kinevox::run(std::max(poses, 1), std::max(queries, 1));
}
