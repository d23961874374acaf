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
                                  "+- s", "frames", "evidence", "next best shift");
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        const std::string rival =
            fit.rival > 0 ? fmt::format("{:+.3f} s fits {:.0f} % as well", fit.rival_shift_s, 100 * fit.rival)
                          : "none near";
        out +=
            fmt::format("{:<{}} {:>10.4f} {:>8.4f} {:>9.2f} {:>9.0f}  {}\n", session.cameras[c].name, width,
                        fit.offset_s, fit.deviation_s, fit.offset_s * session.fps, fit.evidence, rival);
    }
    return out;
}

Json json_of(const Session& session, const Alignment& alignment) {
    Json cameras = Json::array(), pairs = Json::array();
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        cameras.push_back({{"name", session.cameras[c].name},
                           {"offset_s", fit.offset_s},
                           {"deviation_s", fit.deviation_s},
                           {"evidence_nats", fit.evidence},
                           {"next_best_quality", fit.rival},
                           {"next_best_shift_s", fit.rival_shift_s}});
    }
    for (const PairFit& pair : alignment.solution.pairs) {
        Json one = {{"first", session.cameras[pair.first].name},
                    {"second", session.cameras[pair.second].name},
                    {"lag_s", number(pair.lag_frames / session.fps)},
                    {"deviation_s", number(pair.deviation_frames / session.fps)},
                    {"disagrees_s", number(pair.disagrees_frames / session.fps)},
                    {"weight", pair.weight},
                    {"evidence_nats", pair.evidence}};
        one["silhouettes_miss_px"] = pair.miss_px ? Json(*pair.miss_px) : Json(nullptr);
        pairs.push_back(std::move(one));
    }
    return {{"kind", "alignment"},
            {"session", session.name},
            {"fps", session.fps},
            {"used_places", alignment.used_places},
            {"cameras", std::move(cameras)},
            {"pairs", std::move(pairs)}};
}

Json page_json_of(const Session& session, const Alignment& alignment) {
    Json out = json_of(session, alignment);
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        Json& camera = out["cameras"][c];
        camera["curve"] = {{"first_shift_s", fit.curve.lowest_frames / session.fps},
                           {"evidence_nats", rounded(fit.curve.evidence, 0.01)}};
        camera["changed_part_per_s"] = rounded(alignment.movements[c].changed_part, 1e-4);
        camera["top_rises_per_s"] = rounded(alignment.movements[c].top, 1e-4);
    }
    return out;
}

}  // namespace kinevox::sync
