// Features of the pixels that the shadow rule decides, for learning its weights (shadow_rule.py).
//   shadow_features SESSION.toml OUT.bin [STEP [faint]]
// Segments every STEP-th frame set (default 3), with `faint` also faint blocks, and writes, per doubtful
// pixel, a record of int16 frame, camera, x, y, then float32 evidence without the rule and the features of
// kernels/shared/kde_shadow.h.
#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string_view>
#include <vector>

#include "kernels/cpu/shadow_training.h"
#include "kernels/segmentation.h"
#include "server/cameras/session_source.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {
namespace {

struct Record {
    std::int16_t frame, camera, x, y;
    float evidence;
    float features[kernels::kde::kShadowFeatures];
};

int fail(const absl::Status& status) {
    fmt::print(stderr, "shadow_features: {}\n", std::string(status.message()));
    return 1;
}

int write_features(const char* session_file, const char* out_file, int step, bool faint) {
    const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
    auto source = open_session_source(session_file, {});
    if (!source.ok()) return fail(source.status());
    auto empty = (*source)->background();
    if (!empty.ok()) return fail(empty.status());
    const std::vector<Camera>& cameras = (*source)->cameras();
    std::ofstream out(out_file, std::ios::binary);
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;
    std::int16_t frame = 0;
    const kernels::SegmentationOptions options{.judge_faint = faint};
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        segmenters.push_back(
            kernels::make_segmenter(kernels::Device::kCpu, cameras[c].width, cameras[c].height, 3, options));
        segmenters.back()->set_camera(to_kernel(cameras[c]));
        std::vector<kernels::ImageView> views;
        for (const Image& image : (*empty)[c]) views.push_back(to_kernel(image));
        segmenters.back()->learn(views);
        kernels::cpu::observe_shadows(
            *segmenters.back(), [&, c](int x, int y, const float* features, float evidence) {
                Record record{frame,
                              static_cast<std::int16_t>(c),
                              static_cast<std::int16_t>(x),
                              static_cast<std::int16_t>(y),
                              evidence,
                              {}};
                std::copy_n(features, kernels::kde::kShadowFeatures, record.features);
                out.write(reinterpret_cast<const char*>(&record), sizeof record);
            });
    }
    std::vector<kernels::Silhouettes> silhouettes(cameras.size());
    for (;; ++frame) {
        auto frame_set = (*source)->next();
        if (absl::IsOutOfRange(frame_set.status())) break;
        if (!frame_set.ok()) return fail(frame_set.status());
        if (frame % step != 0) continue;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            segmenters[c]->begin_frame(to_kernel(frame_set->images[c]), {});
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            std::vector<const kernels::Segmenter*> others;
            for (std::size_t other = 0; other < cameras.size(); ++other)
                if (other != c) others.push_back(segmenters[other].get());
            segmenters[c]->decide(others, silhouettes[c]);
        }
        for (std::size_t c = 0; c < cameras.size(); ++c) segmenters[c]->end_frame(silhouettes[c]);
    }
    return out ? 0 : 1;
}

}  // namespace
}  // namespace kinevox

int main(int count, char** arguments) {
    const bool faint = count == 5 && std::string_view(arguments[4]) == "faint";
    if (count < 3 || count > 5 || (count == 5 && !faint)) {
        fmt::print(stderr, "usage: shadow_features SESSION.toml OUT.bin [STEP [faint]]\n");
        return 2;
    }
    return kinevox::write_features(arguments[1], arguments[2], count > 3 ? std::atoi(arguments[3]) : 3,
                                   faint);
}
