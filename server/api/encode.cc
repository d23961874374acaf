#include "server/api/encode.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/volume_codec.h"

namespace kinevox {
namespace {

EncodedVolume make_volume(const PublishedVolume& published, const VolumeForm& form) {
    if (!published.volume) return {};
    const VolumeCodecOptions options{.with_colours = form.with_colours};
    if (form.level == 0) return {encode_volume(*published.volume, options), published.volume->grid.voxel_m};
    const Volume coarse = coarsened(*published.volume, form.level);
    return {encode_volume(coarse, options), coarse.grid.voxel_m};
}

// The sharp silhouette white, what only the loose one has grey.
cv::Mat silhouette_picture(const kernels::Silhouettes& silhouettes) {
    const auto pixels = static_cast<std::size_t>(silhouettes.width) * static_cast<std::size_t>(silhouettes.height);
    if (pixels == 0 || silhouettes.sharp.size() != pixels || silhouettes.loose.size() != pixels) return {};
    cv::Mat picture(silhouettes.height, silhouettes.width, CV_8UC1);
    for (std::size_t i = 0; i < pixels; ++i)
        picture.data[i] = silhouettes.sharp[i] ? 255 : silhouettes.loose[i] ? 128 : 0;
    return picture;
}

cv::Mat scaled_to_fit(const cv::Mat& picture, int max_width_px, int max_height_px) {
    double scale = std::min(1.0, static_cast<double>(max_width_px) / picture.cols);
    if (max_height_px > 0) scale = std::min(scale, static_cast<double>(max_height_px) / picture.rows);
    if (scale >= 1) return picture;
    const auto scaled = [&](int length) { return std::max(1, static_cast<int>(std::lround(scale * length))); };
    cv::Mat out;
    cv::resize(picture, out, {scaled(picture.cols), scaled(picture.rows)}, 0, 0, cv::INTER_AREA);
    return out;
}

EncodedPreview make_preview(const FrameResult& result, const PreviewForm& form) {
    cv::Mat picture;
    if (form.silhouette) {
        if (form.camera < result.silhouettes.size()) picture = silhouette_picture(result.silhouettes[form.camera]);
    } else if (form.camera < result.frame_set.pictures.size()) {
        const Picture& from = result.frame_set.pictures[form.camera];
        if (!from.empty())   // only read; cv::Mat knows no const data
            picture = cv::Mat(from.height, from.width, from.channels == 1 ? CV_8UC1 : CV_8UC3,
                              const_cast<std::uint8_t*>(from.data.get()));
    }
    if (picture.empty()) return {};
    const cv::Mat small = scaled_to_fit(picture, form.max_width_px, form.max_height_px);
    std::vector<std::uint8_t> jpeg;
    cv::imencode(".jpg", small, jpeg, {cv::IMWRITE_JPEG_QUALITY, form.jpeg_quality});
    return {std::string(jpeg.begin(), jpeg.end()), small.cols, small.rows};
}

}  // namespace

std::shared_ptr<const EncodedVolume> encode(const PublishedVolume& published, const VolumeForm& form) {
    return published.encodings.get(form, [&] { return make_volume(published, form); });
}

std::shared_ptr<const EncodedPreview> encode(const PublishedPictures& published, const PreviewForm& form) {
    return published.encodings.get(form, [&] { return make_preview(*published.result, form); });
}

}  // namespace kinevox
