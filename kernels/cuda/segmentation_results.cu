#include <algorithm>
#include <cstring>

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

// Masks and probability of so many cells.
std::size_t body_of(std::size_t cells) {
    return cells * (2 * sizeof(Word) + kCellPixels);
}

std::size_t cells_of(const SegmentData& camera) {
    return static_cast<std::size_t>(camera.work.rows()) * camera.work.columns();
}

// 255 for each pixel that is set; the others stay as they are.
void set_pixels(Word pixels, int count, std::uint8_t* to) {
    if (pixels == 0) return;
    if (pixels == ~Word{0}) {
        std::memset(to, 255, kCellPixels);
        return;
    }
    if (count < kCellPixels) {
        for (int i = 0; i < count; ++i)
            if (pixels >> i & 1) to[i] = 255;
        return;
    }
    for (int i = 0; i < kCellPixels; i += 8, pixels >>= 8) {
        // Bit n of the lowest byte to byte n.
        const std::uint64_t bits = ((pixels & 255) * 0x0101010101010101u) & 0x8040201008040201u;
        const std::uint64_t bytes = ((bits + 0x7f7f7f7f7f7f7f7fu) >> 7 & 0x0101010101010101u) * 255;
        std::memcpy(to + i, &bytes, 8);
    }
}

// Elsewhere the planes are 0 already.
void clear(const SegmentData& camera, Silhouettes& out) {
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * camera.height;
    const bool reused = out.width == camera.width && out.height == camera.height;
    const auto clear_plane = [&](std::vector<std::uint8_t>& plane, const Rect& dirty) {
        if (!reused || plane.size() != pixels) return plane.assign(pixels, 0);
        for (int y = dirty.y0; y < dirty.y1; ++y)
            std::memset(plane.data() + static_cast<std::size_t>(y) * camera.width + dirty.x0, 0,
                        dirty.width());
    };
    clear_plane(out.probability, out.searched);
    clear_plane(out.sharp, out.bounds);
    clear_plane(out.loose, out.bounds);
}

}  // namespace

void FrameResults::unpack(const SegmentData& camera, const Rect& searched, Silhouettes& out) const {
    clear(camera, out);
    out.width = camera.width, out.height = camera.height;
    out.searched = searched;
    const CellRange& box = result_->box;
    for (int y = box.y0; y < box.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * camera.width;
        const int x0 = box.k0 * kCellPixels, x1 = std::min(box.k1 * kCellPixels, camera.width);
        if (x0 < x1)
            std::memcpy(out.probability.data() + row + x0,
                        probability_ + camera.result_cell(y, box.k0) * kCellPixels, x1 - x0);
        for (int k = box.k0; k < box.k1; ++k) {
            const std::size_t at = row + static_cast<std::size_t>(k) * kCellPixels;
            const int count = std::min(kCellPixels, camera.width - k * kCellPixels);
            set_pixels(sharp_[camera.result_cell(y, k)], count, out.sharp.data() + at);
            set_pixels(loose_[camera.result_cell(y, k)], count, out.loose.data() + at);
        }
    }
    const int* bounds = result_->bounds;
    const Rect found{bounds[0], bounds[1], bounds[2], bounds[3]};
    out.bounds = found.empty() ? Rect{} : found;
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
    std::size_t most = 0, used = 0;
    head_ = 0;
    for (const SegmentData* camera : cameras) {
        head_ += head_of(*camera);
        used += body_of(cells_of(*camera));
        most += head_of(*camera) + body_of(camera->cell(camera->height, 0));
    }
    device_.resize(most);
    host_.resize(most);
    device_.resize(head_ + used);
    host_.resize(head_ + used);
    std::vector<FrameResults> all;
    std::size_t head = 0, body = head_;
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
    fill_bytes(stream, device_.data(), 0, head_);
}

void ResultMemory::queue_download(const Stream& stream) const {
    download(stream, host_.data(), device_.data(), device_.size());
}

}  // namespace kinevox::kernels::cuda
