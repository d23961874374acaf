// Results as they leave the daemon: each message's bytes, but for header.missed, which every subscriber has
// his own of. Run on the encoders' threads; made by the first who asks for a form, shared with the others.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <string>

#include "server/pipeline/stream_hub.h"

namespace kinevox {

class Runner;

using EncodedMessage = std::shared_ptr<const std::string>;

// StreamVolumesResponse. The runner is asked for the cameras, whose names the subject's message tells.
EncodedMessage encode(const PublishedVolume& published, const VolumeForm& form, const Runner& runner);
// StreamPosesResponse.
EncodedMessage encode(const PublishedPose& published);
// StreamPreviewsResponse; without a picture (or, for a silhouette, without one) no bytes in it.
EncodedMessage encode(const PublishedPictures& published, const PreviewForm& form, const std::string& camera);

// What is written to one subscriber: the shared bytes, uncopied, and behind them a header that holds `missed`
// alone. Protocol Buffers' readers merge a message field that comes twice (Encoding, "Last One Wins").
grpc::ByteBuffer to_buffer(const EncodedMessage& message, std::uint64_t missed);

}  // namespace kinevox
