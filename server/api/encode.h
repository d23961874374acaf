// The forms in which results leave the daemon: compact volumes and small JPEGs. Run on the encoders' threads.
#pragma once

#include <memory>

#include "server/pipeline/stream_hub.h"

namespace kinevox {

// Made by the first who asks for this form, shared with the others. Without a volume: no bytes.
std::shared_ptr<const EncodedVolume> encode(const PublishedVolume& published, const VolumeForm& form);

// Without a picture (or, for a silhouette, without one): no bytes.
std::shared_ptr<const EncodedPreview> encode(const PublishedPictures& published, const PreviewForm& form);

}  // namespace kinevox
