#include "server/tools/sync/alignment_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace kinevox::sync {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json rounded(const std::vector<double>& values, double step) {
    Json list = Json::array();
    for (const double v : values)
        list.push_back(std::isfinite(v) ? Json(std::round(v / step) * step) : Json(nullptr));
    return list;
}

}  // namespace

std::string table_of(const Session& session, const Alignment& alignment) {
    std::size_t width = 6;
    for (const SessionCamera& camera : session.cameras) width = std::max(width, camera.name.size());
    std::string out = fmt::format("{:<{}} {:>10} {:>8} {:>9} {:>9}  {}\n", "camera", width, "offset s",
                                  "std s", "frames", "evidence", "runner-up");
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        const std::string runner_up =
            fit.runner_up > 0
                ? fmt::format("{:+.3f} s, {:.0f} % as good", fit.runner_up_offset_s, 100 * fit.runner_up)
                : "none";
        out +=
            fmt::format("{:<{}} {:>10.4f} {:>8.4f} {:>9.2f} {:>9.0f}  {}\n", session.cameras[c].name, width,
                        fit.offset_s, fit.std_s, fit.offset_s * session.fps, fit.evidence, runner_up);
    }
    return out;
}

Json json_of(const Session& session, const Alignment& alignment) {
    Json cameras = Json::array(), pairs = Json::array();
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        cameras.push_back({{"name", session.cameras[c].name},
                           {"offset_s", fit.offset_s},
                           {"std_s", fit.std_s},
                           {"evidence_nats", fit.evidence},
                           {"runner_up_ratio", fit.runner_up},
                           {"runner_up_offset_s", fit.runner_up_offset_s}});
    }
    for (const PairFit& pair : alignment.solution.pairs) {
        Json one = {{"first", session.cameras[pair.first].name},
                    {"second", session.cameras[pair.second].name},
                    {"lag_s", number(pair.lag_frames / session.fps)},
                    {"std_s", number(pair.std_frames / session.fps)},
                    {"residual_s", number(pair.residual_frames / session.fps)},
                    {"weight", pair.weight},
                    {"evidence_nats", pair.evidence}};
        one["silhouette_residual_px"] = pair.residual_px ? Json(*pair.residual_px) : Json(nullptr);
        pairs.push_back(std::move(one));
    }
    return {{"kind", "alignment"},
            {"session", session.name},
            {"fps", session.fps},
            {"used_extrinsics", alignment.used_extrinsics},
            {"cameras", std::move(cameras)},
            {"pairs", std::move(pairs)}};
}

Json page_json_of(const Session& session, const Alignment& alignment) {
    Json out = json_of(session, alignment);
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        Json& camera = out["cameras"][c];
        camera["curve"] = {{"first_offset_s", fit.curve.lowest_frames / session.fps},
                           {"evidence_nats", rounded(fit.curve.evidence, 0.01)}};
        camera["changed_fraction_per_s"] = rounded(alignment.movements[c].changed_fraction, 1e-4);
        camera["top_rises_per_s"] = rounded(alignment.movements[c].top, 1e-4);
    }
    return out;
}

}  // namespace kinevox::sync
