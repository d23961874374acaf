// A person of capsules that walks on the spot in a ring of cameras, and the stages that turn its images into
// a coloured volume, as the pipeline calls them.
#pragma once

#include <memory>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/segmentation.h"

namespace kinevox::kernels::bench {

struct FrameSetSize {
    int cameras = 4, width = 640, height = 480;
    float voxel_m = 0.01f;
    float span_m = 2;  // of the lattice, each axis
};

struct StageTimes {
    double segmentation_ms = 0;
    double hull_ms = 0;       // 0 where the device carves and colours at once
    double colouring_ms = 0;  // then with the hull
};

class FrameSetRig {
  public:
    FrameSetRig(Device device, const FrameSetSize& size);
    // The next frame set; the first one searches whole images, later ones follow the person.
    StageTimes run();
    const VoxelVolume& volume() const { return volume_; }

  private:
    struct Frame {
        std::vector<std::vector<std::uint8_t>> images,
            masks;  // one per camera; mask: 255 where the person is
        std::vector<Rect> bounds;
    };
    struct Background;

    Frame draw(float stride, Background& background) const;
    void segment(const Frame& frame);
    ImageView view(const std::vector<std::uint8_t>& image) const;

    FrameSetSize size_;
    std::vector<CameraModel> cameras_;
    std::vector<Frame> frames_;
    std::size_t count_ = 0;  // of frame sets so far
    std::vector<std::unique_ptr<Segmenter>> segmenters_;
    std::unique_ptr<HullCarver> carver_;
    std::unique_ptr<VoxelColourer> colourer_;
    std::vector<Silhouettes> silhouettes_;
    Lattice lattice_;
    VoxelVolume volume_;
};

}  // namespace kinevox::kernels::bench
