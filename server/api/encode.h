// Results as serialised messages, without header.missed_count, which differs per subscriber. Encoded on the
// encoders' threads for the first subscriber that needs a form, and shared with the others.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <string>

#include "server/pipeline/stream_hub.h"

namespace kinevox {

class Runner;

using EncodedMessage = std::shared_ptr<const std::string>;

// StreamVolumesResponse. The runner provides the cameras' names.
EncodedMessage encode(const PublishedVolume& published, const VolumeForm& form, const Runner& runner);
// StreamPosesResponse.
EncodedMessage encode(const PublishedPose& published);
// StreamPreviewsResponse; its jpeg is empty if there is no image or no silhouette.
EncodedMessage encode(const PublishedImages& published, const PreviewForm& form, const std::string& camera);

// The bytes for one subscriber: the shared bytes, uncopied, followed by a header with missed_count only.
// Protocol Buffers' parsers merge a message field that occurs twice (Encoding, "Last One Wins").
grpc::ByteBuffer to_buffer(const EncodedMessage& message, std::uint64_t missed_count);

}  // namespace kinevox
