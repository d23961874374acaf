#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/volume_codec.h"
#include "kinevox/v1/stream_service.pb.h"
#include "server/api/to_proto.h"
#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

void fill_header(const PublishedHeader& published, v1::StreamHeader* header) {
    header->set_sequence(published.sequence);
    header->set_capture_time_ns(published.capture_time_utc_ns);
    header->set_publish_time_ns(published.published_utc_ns);
    *header->mutable_stage_times() = to_proto(published.times);
    if (published.recorded_frame) header->set_recorded_frame(*published.recorded_frame);
}

void fill_volume(const PublishedVolume::Subject& published, const VolumeForm& form,
                 v1::SubjectVolume* message) {
    const VolumeCodecOptions options{.with_colours = form.with_colours};
    message->set_volume_litres(published.litres);
    if (form.level == 0) {
        message->set_encoded_volume(encode_volume(*published.volume, options));
        message->set_voxel_m(published.volume->grid.voxel_m);
        return;
    }
    const Volume coarse = coarsened(*published.volume, form.level);
    message->set_encoded_volume(encode_volume(coarse, options));
    message->set_voxel_m(coarse.grid.voxel_m);
}

// White: sharp silhouette; grey: loose silhouette only.
cv::Mat silhouette_image(const kernels::Silhouettes& silhouettes) {
    const auto pixels =
        static_cast<std::size_t>(silhouettes.width) * static_cast<std::size_t>(silhouettes.height);
    if (pixels == 0 || silhouettes.sharp.size() != pixels || silhouettes.loose.size() != pixels) return {};
    cv::Mat image(silhouettes.height, silhouettes.width, CV_8UC1);
    for (std::size_t i = 0; i < pixels; ++i)
        image.data[i] = silhouettes.sharp[i] ? 255 : silhouettes.loose[i] ? 128 : 0;
    return image;
}

cv::Mat scaled_to_fit(const cv::Mat& image, int max_width_px, int max_height_px) {
    double scale = std::min(1.0, static_cast<double>(max_width_px) / image.cols);
    if (max_height_px > 0) scale = std::min(scale, static_cast<double>(max_height_px) / image.rows);
    if (scale >= 1) return image;
    const auto scaled = [&](int length) {
        return std::max(1, static_cast<int>(std::lround(scale * length)));
    };
    cv::Mat out;
    cv::resize(image, out, {scaled(image.cols), scaled(image.rows)}, 0, 0, cv::INTER_AREA);
    return out;
}

void fill_preview(const FrameResult& result, const PreviewForm& form, v1::StreamPreviewsResponse* message) {
    cv::Mat image;
    if (form.silhouette) {
        if (form.camera < result.silhouettes.size())
            image = silhouette_image(result.silhouettes[form.camera]);
    } else if (form.camera < result.frame_set.images.size()) {
        const Image& from = result.frame_set.images[form.camera];
        if (!from.empty()) image = as_mat(from);
    }
    if (image.empty()) return;
    const cv::Mat small = scaled_to_fit(image, form.max_width_px, form.max_height_px);
    std::vector<std::uint8_t> jpeg;
    cv::imencode(".jpg", small, jpeg, {cv::IMWRITE_JPEG_QUALITY, form.jpeg_quality});
    message->set_jpeg(jpeg.data(), jpeg.size());
    message->set_width_px(small.cols);
    message->set_height_px(small.rows);
}

}  // namespace

EncodedMessage encode(const PublishedVolume& published, const VolumeForm& form, const Runner& runner) {
    return published.encodings.get(form, [&] {
        v1::StreamVolumesResponse message;
        fill_header(published.header, message.mutable_header());
        for (const PublishedVolume::Subject& one : published.subjects) {
            v1::SubjectVolume* subject = message.add_subjects();
            *subject->mutable_subject() = to_proto(one.track, runner.cameras());
            if (one.volume) fill_volume(one, form, subject);
        }
        return message.SerializeAsString();
    });
}

EncodedMessage encode(const PublishedPose& published) {
    return published.encodings.get({}, [&] {
        v1::StreamPosesResponse message;
        fill_header(published.header, message.mutable_header());
        for (const PublishedPose::Subject& one : published.subjects) {
            v1::SubjectPose* subject = message.add_subjects();
            subject->set_subject_id(one.subject_id);
            subject->set_name(one.name);
            if (one.pose) *subject->mutable_pose() = to_proto(*one.pose);
        }
        return message.SerializeAsString();
    });
}

EncodedMessage encode(const PublishedImages& published, const PreviewForm& form, const std::string& camera) {
    return published.encodings.get(form, [&] {
        v1::StreamPreviewsResponse message;
        fill_header(published.header(), message.mutable_header());
        message.set_camera(camera);
        fill_preview(*published.result, form, &message);
        return message.SerializeAsString();
    });
}

grpc::ByteBuffer to_buffer(const EncodedMessage& message, std::uint64_t missed_count) {
    const auto release = [](void* owner) { delete static_cast<EncodedMessage*>(owner); };
    grpc::Slice slices[2] = {grpc::Slice(const_cast<char*>(message->data()), message->size(), release,
                                         new EncodedMessage(message)),
                             {}};
    if (missed_count == 0) return {slices, 1};
    v1::StreamPosesResponse own;  // the header has the same number in all three
    static_assert(int{v1::StreamPosesResponse::kHeaderFieldNumber} ==
                      int{v1::StreamVolumesResponse::kHeaderFieldNumber} &&
                  int{v1::StreamPosesResponse::kHeaderFieldNumber} ==
                      int{v1::StreamPreviewsResponse::kHeaderFieldNumber});
    own.mutable_header()->set_missed_count(missed_count);
    slices[1] = grpc::Slice(own.SerializeAsString());
    return {slices, 2};
}

}  // namespace kinevox
