// The host's side of a volume on the device: memory, uploads, the order of the steps and one wait.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/cuda/hull_maps.h"
#include "kernels/cuda/volume.h"
#include "kernels/hull.h"

namespace kinevox::kernels::cuda {

// From a hull, or from bricks that are given, to bricks, and colours if they are asked for.
struct VolumeRequest {
    Lattice lattice;
    const HullOptions* hull = nullptr;  // null: `given`
    std::span<const HullView> hull_views;
    std::span<const Brick> given;
    const ColouringOptions* colouring = nullptr;  // null: the hull alone
    std::span<const ColouringView> views;
};

// Throws std::invalid_argument as the carver does. Skips views without a silhouette.
std::vector<SilhouetteView> hull_silhouettes(std::span<const HullView> views, const Lattice& lattice,
                                             float miss_budget_permille);

class VolumeMaker {
  public:
    explicit VolumeMaker(int gpu) : stream_(gpu) {}

    // With a hull, at least one view has a silhouette; for colours, at least one view. Waits once, again
    // where the volume needs more room than any before and after each kMaxRounds rounds.
    void make(const VolumeRequest& request, VoxelVolume& volume, ColouringReport& report);

  private:
    // Where the pieces of the upload begin.
    struct Pieces {
        std::size_t job = 0, map_views = 0, maps = 0, views = 0, given = 0, state = 0, view_states = 0,
                    out = 0;
    };
    // A mask to be packed, and where it goes.
    struct MaskUpload {
        const std::uint8_t* mask = nullptr;
        int width = 0;
        Rect box;
        std::size_t at = 0;
    };

    void frame(const VolumeRequest& request);
    std::size_t add_mask(const std::uint8_t* mask, const Projector& camera, const Rect& box);
    void frame_colouring(const VolumeRequest& request);
    void place_pieces(const VolumeRequest& request);
    void place_memory(const VolumeRequest& request);
    VolumeJob job_of(const VolumeRequest& request) const;
    void upload(const VolumeRequest& request);
    void queue_steps(const VolumeRequest& request, int rounds);
    void queue(const VolumeRequest& request);
    bool queue_more(const VolumeRequest& request, ColouringReport& report);
    void fetch();
    bool grow();
    int count_rounds(int rounds, ColouringReport& report) const;
    void take(const VolumeRequest& request, VoxelVolume& volume, ColouringReport& report) const;

    const VolumeJob* job() const { return upload_.device<VolumeJob>(pieces_.job); }
    const VolumeState& state() const { return *reinterpret_cast<const VolumeState*>(results_.data()); }
    VolumeBlocks volume_blocks() const;
    int view_count() const { return static_cast<int>(views_.size()); }

    Stream stream_;
    bool in_flight_ = false;  // the device may still read pinned memory
    VolumeRoom room_{128, 4096, 2048};
    int now_ = 0, look_ = 0;              // see queue_rounds()
    int now_after_ = 0, look_after_ = 0;  // the same after all steps

    int hull_views_ = 0;
    std::vector<MapsOfView> map_views_;  // the hull's, then those of the sharp silhouettes
    std::vector<std::size_t> map_masks_;
    std::vector<VolumeView> views_;
    std::vector<int> sharp_of_view_;  // index into map_views_, or -1
    std::vector<std::size_t> view_masks_, view_images_;
    std::vector<MaskUpload> masks_;
    std::vector<SilhouetteView> silhouettes_;
    Pieces pieces_;
    std::size_t spare_bytes_ = 0;  // by which masks and bricks may grow

    KernelGraph graph_;
    PackedUpload upload_;
    PinnedBuffer<std::uint8_t> results_;
    HullMapMemory maps_;
    DeviceBuffer<BlockState> super_states_, states_;
    DeviceBuffer<int> group_places_, index_, surface_;
    DeviceBuffer<BrickPosition> positions_;
    DeviceBuffer<std::uint64_t> occupancy_;
    DeviceBuffer<std::uint8_t> changed_, means_;
    DeviceBuffer<DepthPair> depths_;
    DeviceBuffer<CellColour> colours_;
};

}  // namespace kinevox::kernels::cuda
