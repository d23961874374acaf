// What each camera sees of a volume, on the device: its depth images on a grid of cells, and the colours
// and the silhouette on that grid. See kernels/cpu/visibility.h for the ideas.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/colouring.h"
#include "kernels/cpu/visibility.h"
#include "kernels/cuda/surface.h"
#include "kernels/shared/colouring.h"

namespace kinevox::kernels::cuda {

// One view as the kernels know it; device pointers.
struct ViewOnDevice {
    Projector camera;
    int shift = 0;                                // a cell is 2^shift px wide and high
    Rect cells;                                   // the part of the image that is looked at, in cells
    int width = 0, height = 0;                    // of `cells`
    float *front_m = nullptr, *back_m = nullptr;  // per cell, as ViewOfVolume
    float *front_scratch = nullptr, *back_scratch = nullptr;  // per cell
    int* nearest = nullptr;  // bits of the nearest seen voxel's depth, m; kFar_m where none is seen

    const std::uint8_t* image = nullptr;  // the part `image_box`, without padding; null: none
    int channels = 0;
    Rect image_box;                 // px
    std::uint8_t* means = nullptr;  // B, G, R per cell, of width + 2 by height + 2 cells
    CellColour* colours = nullptr;  // per cell

    const std::uint8_t* mask = nullptr;    // for silhouette_iou(), the whole image; null: none
    Rect mask_box;                         // px, where its foreground is counted
    unsigned long long* counts = nullptr;  // px: mask, projection, both
};

// Where a surface voxel falls in a view: [view][voxel].
struct VoxelCells {
    VoxelCell* cells = nullptr;
    int count = 0;  // voxels
    __host__ __device__ VoxelCell& at(int view, int voxel) const {
        return cells[static_cast<std::size_t>(view) * count + voxel];
    }
};

class DeviceViews {
  public:
    // Finds the part of each image that the volume covers, and queues copies of that part and of the masks
    // and the work on the cells' colours, with the limits of colour_limit(). At least one view. The stream
    // must have been waited for before.
    void frame(const Stream& stream, std::span<const ColouringView> views, const Lattice& lattice,
               const DeviceVolume& volume, float max_difference_std, float noise_grey);

    // Projects the surface and fills the depth images.
    void look(const Stream& stream, const Lattice& lattice, const SurfaceList& surface);

    // Intersection over union of the volume's projection and the silhouette, as silhouette_iou();
    // waits.
    std::vector<float> silhouette_iou(const Stream& stream, float voxel_m);

    const ViewOnDevice* views() const { return device_views_.data(); }
    int count() const { return static_cast<int>(views_.size()); }
    const VoxelCells& voxel_cells() const { return voxel_cells_; }

  private:
    void find_cells(const Stream& stream, const Lattice& lattice, const DeviceVolume& volume);
    void place_images(const Stream& stream, std::span<const ColouringView> views);

    PinnedBuffer<ViewOnDevice> views_;
    PinnedBuffer<std::uint8_t> host_bytes_;
    PinnedBuffer<int> host_boxes_;
    PinnedBuffer<unsigned long long> host_sums_;
    DeviceBuffer<ViewOnDevice> device_views_;
    DeviceBuffer<std::uint8_t> bytes_, means_;
    DeviceBuffer<int> boxes_;                // 4 a view
    DeviceBuffer<unsigned long long> sums_;  // 2 a view: depths, bricks
    DeviceBuffer<float> depths_;
    DeviceBuffer<int> nearest_;
    DeviceBuffer<CellColour> colours_;
    DeviceBuffer<VoxelCell> cells_;
    DeviceBuffer<unsigned long long> counts_;
    VoxelCells voxel_cells_;
    std::size_t max_cells_ = 0, max_px_ = 0;
};

}  // namespace kinevox::kernels::cuda
