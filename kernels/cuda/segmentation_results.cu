#include <algorithm>

#include "kernels/cpu/packed_silhouettes.h"
#include "kernels/cuda/segmentation_results.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

std::size_t aligned(std::size_t bytes) {
    constexpr std::size_t kAligned = 16;
    return (bytes + kAligned - 1) / kAligned * kAligned;
}

std::size_t head_of(const SegmentData& camera) {
    return aligned(sizeof(CameraResult)) + aligned(camera.colour_bins * sizeof(int));
}

// Masks and probability of a number of cells.
std::size_t body_of(std::size_t cells) {
    return cells * (2 * sizeof(Word) + kCellPixels);
}

std::size_t cells_of(const SegmentData& camera) {
    return static_cast<std::size_t>(camera.work.rows()) * camera.work.columns();
}

}  // namespace

void FrameResults::unpack(const SegmentData& camera, const Rect& searched, Silhouettes& out) const {
    const CellRange& box = result_->box;
    const Rect found{box.k0 * kCellPixels, box.y0, std::min(box.k1 * kCellPixels, camera.width), box.y1};
    cpu::unpack({camera.width, camera.height, searched, found, sharp_, loose_, probability_}, out);
    const int* bounds = result_->bounds;
    const Rect around{bounds[0], bounds[1], bounds[2], bounds[3]};
    out.bounds = around.empty() ? Rect{} : around;
    out.sharp_pixels = static_cast<std::int64_t>(result_->sums[0]);
    const auto mean = [&](int n) {
        return out.sharp_pixels > 0
                   ? static_cast<double>(result_->sums[n]) / static_cast<double>(out.sharp_pixels)
                   : 0;
    };
    out.centroid_x = mean(1), out.centroid_y = mean(2);
}

std::vector<FrameResults> ResultMemory::place(std::span<SegmentData* const> cameras) {
    // For whole images, since memory that grew with the tracked region would stop the device now and then.
    std::size_t max_bytes = 0, used = 0, heads = 0;  // the heads are first
    for (const SegmentData* camera : cameras) {
        heads += head_of(*camera);
        used += body_of(cells_of(*camera));
        max_bytes += head_of(*camera) + body_of(camera->cell(camera->height, 0));
    }
    device_.resize(max_bytes);
    host_.resize(max_bytes);
    device_.resize(heads + used);
    host_.resize(heads + used);
    std::vector<FrameResults> all;
    std::size_t head = 0, body = heads;
    for (SegmentData* camera : cameras) {
        const std::size_t cells = cells_of(*camera), counts = head + aligned(sizeof(CameraResult)),
                          probability = body + 2 * cells * sizeof(Word);
        FrameResults& results = all.emplace_back();
        camera->result = reinterpret_cast<CameraResult*>(device_.data() + head);
        results.result_ = reinterpret_cast<const CameraResult*>(host_.data() + head);
        camera->colour_counts = reinterpret_cast<int*>(device_.data() + counts);
        results.counts_ = reinterpret_cast<const int*>(host_.data() + counts);
        camera->result_sharp = reinterpret_cast<Word*>(device_.data() + body);
        results.sharp_ = reinterpret_cast<const Word*>(host_.data() + body);
        camera->result_loose = camera->result_sharp + cells;
        results.loose_ = results.sharp_ + cells;
        camera->result_probability = device_.data() + probability;
        results.probability_ = host_.data() + probability;
        head += head_of(*camera);
        body += body_of(cells);
    }
    return all;
}

void ResultMemory::queue_clear(const Stream& stream) const {
    fill_bytes(stream, device_.data(), 0, device_.size());
}

void ResultMemory::queue_download(const Stream& stream) const {
    download(stream, host_.data(), device_.data(), device_.size());
}

}  // namespace kinevox::kernels::cuda
