#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

#include "kernels/cpu/colouring_steps.h"
#include "kernels/cpu/hull_maps.h"
#include "kernels/cpu/run_components.h"
#include "kernels/cpu/upload_work.h"
#include "kernels/cuda/volume_maker.h"
#include "kernels/shared/surrounded.h"

namespace kinevox::kernels::cuda {
namespace {

using Word = unsigned long long;

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

Rect inside_image(const Rect& box, const Projector& camera) {
    return intersection_of(box, {0, 0, camera.width, camera.height});
}

// The smallest box around a mask, if it is not known.
Rect bounds_of_mask(const Rect& known, const std::uint8_t* mask, const Projector& camera) {
    return known.empty() ? bounds_of(mask, camera.width, camera.height) : known;
}

std::size_t words_of(const Rect& box) {
    return static_cast<std::size_t>(BitMask{nullptr, box}.row_words()) * std::max(box.height(), 0);
}

float brick_radius_px(const Projector& camera, const Lattice& lattice) {
    return typical_block_radius_px(camera, lattice, 0.5f * kBrickEdge * lattice.voxel_m);
}

CarvingRules rules_of(const ColouringOptions& options, float voxel_m) {
    CarvingRules rules;
    rules.voxel_m = voxel_m;
    rules.by_colour = options.max_colour_difference_std > 0;
    rules.min_ray_length_m = options.min_ray_length_m;
    rules.support_radius = std::clamp(
        static_cast<int>(std::lround((options.support_edge_m / voxel_m - 1) / 2)), 1, kMaxSupportRadius);
    const int edge = 2 * rules.support_radius + 1;
    rules.min_support_count = static_cast<int>(options.min_support * static_cast<float>(edge * edge * edge));
    rules.max_difference_std = options.max_colour_difference_std;
    rules.noise_grey = options.noise_grey;
    return rules;
}

}  // namespace

std::vector<SilhouetteView> hull_silhouettes(std::span<const HullView> views, const Lattice& lattice,
                                             float miss_budget_permille) {
    std::vector<SilhouetteView> out;
    for (const HullView& view : views) {
        if (!view.camera || !view.silhouette) continue;
        const Projector camera = make_projector(*view.camera, "hull: camera");
        out.push_back(
            {view.silhouette, view.bounds, camera, brick_radius_px(camera, lattice), miss_budget_permille});
    }
    if (out.size() > kMaxViews)
        throw std::invalid_argument("hull: " + std::to_string(out.size()) + " views; at most " +
                                    std::to_string(kMaxViews));
    return out;
}

// Returns where the mask's words begin in the upload; at least one, so that a mask without foreground is one.
std::size_t VolumeMaker::add_mask(const std::uint8_t* mask, const Projector& camera, const Rect& box) {
    const std::size_t words = std::max<std::size_t>(words_of(box), 1), at = upload_.reserve<Word>(words);
    spare_bytes_ += (words_of({0, 0, camera.width, camera.height}) + 2 - words) * sizeof(Word);
    masks_.push_back({mask, camera.width, box, at});
    return at;
}

// Sharp silhouettes carve and count; loose ones, if there is no sharp one, count.
void VolumeMaker::frame_colouring(const VolumeRequest& request) {
    const ColouringOptions& options = *request.colouring;
    const bool carves = options.max_rounds > 0 && options.sharp_budget_permille >= 0;
    views_.assign(request.views.size(), {});
    sharp_of_view_.assign(request.views.size(), -1);
    for (std::size_t n = 0; n < views_.size(); ++n) {
        const ColouringView& from = request.views[n];
        VolumeView& view = views_[n];
        view.camera = make_projector(*from.camera, "colouring: camera");
        if (from.sharp && carves) {
            sharp_of_view_[n] = static_cast<int>(silhouettes_.size());
            silhouettes_.push_back({from.sharp, bounds_of_mask(from.bounds, from.sharp, view.camera),
                                    view.camera, brick_radius_px(view.camera, request.lattice),
                                    options.sharp_budget_permille});
        }
    }
}

// What is known of the views without memory on the device.
void VolumeMaker::frame(const VolumeRequest& request) {
    silhouettes_.clear();
    views_.clear();
    if (request.hull)
        silhouettes_ =
            hull_silhouettes(request.hull_views, request.lattice, request.hull->miss_budget_permille);
    hull_views_ = static_cast<int>(silhouettes_.size());
    if (request.colouring) frame_colouring(request);
    map_views_.clear();
    for (const SilhouetteView& silhouette : silhouettes_) map_views_.push_back(frame_maps(silhouette));
}

void VolumeMaker::place_pieces(const VolumeRequest& request) {
    upload_.clear();
    masks_.clear();
    map_masks_.clear();
    spare_bytes_ = request.hull ? 0 : (room_.bricks - request.given.size()) * sizeof(Brick);
    view_masks_.assign(views_.size(), kNone);
    view_images_.assign(views_.size(), kNone);
    pieces_.job = upload_.reserve<VolumeJob>(1);
    pieces_.map_views = upload_.reserve<MapsOfView>(map_views_.size());
    pieces_.maps = upload_.reserve<HullMaps>(map_views_.size());
    pieces_.views = upload_.reserve<VolumeView>(views_.size());
    pieces_.given = upload_.reserve<Brick>(request.given.size());
    for (std::size_t n = 0; n < map_views_.size(); ++n)
        map_masks_.push_back(add_mask(silhouettes_[n].mask, silhouettes_[n].camera, map_views_[n].mask.box));
    for (std::size_t n = 0; n < views_.size(); ++n) {
        const ColouringView& from = request.views[n];
        VolumeView& view = views_[n];
        const std::uint8_t* const mask = from.sharp ? from.sharp : from.silhouette;
        if (const int sharp = sharp_of_view_[n]; sharp >= 0) {
            view.bounds = map_views_[sharp].bounds;
            view.mask.box = map_views_[sharp].mask.box;
            view_masks_[n] = map_masks_[sharp];
        } else if (mask) {
            view.bounds = inside_image(bounds_of_mask(from.bounds, mask, view.camera), view.camera);
            view.mask.box = view.bounds;
            view_masks_[n] = add_mask(mask, view.camera, view.bounds);
        }
        if (!from.image.data) continue;
        view.channels = from.image.channels;
        view.image = from.image_on_device;
        if (view.image) continue;
        view_images_[n] = upload_.reserve<std::uint8_t>(static_cast<std::size_t>(from.image.width) *
                                                        from.image.height * from.image.channels);
    }
    pieces_.state = upload_.reserve<VolumeState>(1);
    pieces_.view_states = upload_.reserve<ViewState>(views_.size());
    pieces_.out = upload_.size();
    upload_.place(room_.bricks * sizeof(Brick) + room_.voxels * sizeof(Colour), spare_bytes_);
    results_.resize(pieces_.out - pieces_.state + room_.bricks * sizeof(Brick) +
                    room_.voxels * sizeof(Colour));
}

void VolumeMaker::place_memory(const VolumeRequest& request) {
    const auto bricks = static_cast<std::size_t>(room_.bricks), cells = static_cast<std::size_t>(room_.cells);
    positions_.resize(bricks);
    occupancy_.resize(2 * bricks * kBrickEdge);
    changed_.resize(2 * bricks);
    surface_.resize(bricks);
    depths_.resize(3 * cells * views_.size());
    colours_.resize(cells * views_.size());
    // Two rows and columns more than cells; a view of one row has the most for its size.
    const std::size_t with_rim = 3 * cells + 6;
    means_.resize(3 * with_rim * views_.size());
    for (std::size_t n = 0; n < views_.size(); ++n) {
        VolumeView& view = views_[n];
        DepthPair* const depths = depths_.data() + 3 * cells * n;
        view.splats[0] = depths, view.splats[1] = depths + cells, view.depths = depths + 2 * cells;
        view.colours = colours_.data() + cells * n;
        view.means = means_.data() + 3 * with_rim * n;
        if (view_masks_[n] != kNone) view.mask.words = upload_.device<Word>(view_masks_[n]);
        if (view_images_[n] != kNone) view.image = upload_.device<std::uint8_t>(view_images_[n]);
    }
    for (std::size_t n = 0; n < map_views_.size(); ++n)
        map_views_[n].mask.words = upload_.device<Word>(map_masks_[n]);
    maps_.place(map_views_);
    const VolumeJob sizes = job_of(request);
    super_states_.resize(sizes.supers.count());
    states_.resize(sizes.grid.count());
    group_places_.resize(sizes.grid.count() / kGroup + 1);
    index_.resize(sizes.index_size());
}

VolumeJob VolumeMaker::job_of(const VolumeRequest& request) const {
    const auto supers = [](int bricks) { return (bricks + kSuperEdge - 1) / kSuperEdge; };
    VolumeJob job;
    job.lattice = request.lattice;
    const int* size = request.lattice.size;
    job.grid = {size[0] / kBrickEdge, size[1] / kBrickEdge, size[2] / kBrickEdge};
    job.supers = {supers(job.grid.x), supers(job.grid.y), supers(job.grid.z)};
    job.room = room_;
    job.map_views = upload_.device<MapsOfView>(pieces_.map_views);
    const HullMaps* const maps = upload_.device<HullMaps>(pieces_.maps);
    job.hull = {maps, hull_views_, request.hull ? request.hull->min_views : 0};
    job.sharp = {maps + hull_views_, static_cast<int>(map_views_.size()) - hull_views_, 0};
    job.super_states = super_states_.data(), job.states = states_.data();
    job.group_places = group_places_.data();
    job.given = upload_.device<Brick>(pieces_.given);
    job.positions = positions_.data();
    job.index = index_.data();
    job.surface = surface_.data();
    for (int n = 0; n < 2; ++n) {
        job.occupancy[n] = occupancy_.data() + static_cast<std::size_t>(n) * room_.bricks * kBrickEdge;
        job.changed[n] = changed_.data() + static_cast<std::size_t>(n) * room_.bricks;
    }
    if (request.colouring) job.rules = rules_of(*request.colouring, request.lattice.voxel_m);
    job.views = upload_.device<VolumeView>(pieces_.views);
    job.view_count = view_count();
    job.state = upload_.device<VolumeState>(pieces_.state);
    job.view_states = upload_.device<ViewState>(pieces_.view_states);
    job.out = upload_.device<Brick>(pieces_.out);
    return job;
}

void VolumeMaker::upload(const VolumeRequest& request) {
    *upload_.host<VolumeJob>(pieces_.job) = job_of(request);
    std::copy(map_views_.begin(), map_views_.end(), upload_.host<MapsOfView>(pieces_.map_views));
    std::transform(map_views_.begin(), map_views_.end(), upload_.host<HullMaps>(pieces_.maps),
                   [](const MapsOfView& view) { return view.maps; });
    std::copy(views_.begin(), views_.end(), upload_.host<VolumeView>(pieces_.views));
    std::copy(request.given.begin(), request.given.end(), upload_.host<Brick>(pieces_.given));
    std::vector<std::function<void()>> tasks;
    for (const MaskUpload& mask : masks_)
        tasks.emplace_back([this, &mask] {
            Word* words = upload_.host<Word>(mask.at);
            const Rect& box = mask.box;
            for (int y = box.y0; y < box.y1; ++y)
                for (int x = box.x0; x < box.x1; x += 64)
                    *words++ =
                        cpu::set_pixels(mask.mask + static_cast<std::size_t>(y) * mask.width, x, box.x1);
        });
    cpu::run_all(tasks);
    for (std::size_t n = 0; n < views_.size(); ++n)
        if (view_images_[n] != kNone)
            cpu::copy_rows(request.views[n].image, 0, request.views[n].image.height,
                           upload_.host<std::uint8_t>(view_images_[n]));
    VolumeState state{};
    state.bricks = state.needed.bricks = static_cast<int>(request.given.size());
    state.carved[0] = 1;
    *upload_.host<VolumeState>(pieces_.state) = state;
    ViewState view{};
    view.nearest[0] = view.nearest[1] = std::bit_cast<int>(kFar_m);
    std::fill_n(upload_.host<ViewState>(pieces_.view_states), views_.size(), view);
    upload_.upload(stream_);
}

VolumeBlocks VolumeMaker::volume_blocks() const {
    // A few of each fit on a processor of the largest device.
    constexpr int kMaxBrickBlocks = 1024, kMaxCellBlocks = 128;
    return {static_cast<unsigned>(std::min(room_.bricks, kMaxBrickBlocks)),
            static_cast<unsigned>(std::min((room_.cells + kThreads - 1) / kThreads, kMaxCellBlocks))};
}

// All steps, with the first rounds.
void VolumeMaker::queue_steps(const VolumeRequest& request, int rounds) {
    const VolumeBlocks blocks = volume_blocks();
    const float voxel_m = request.lattice.voxel_m;
    int now = 0;
    const auto fill = [&](int radius, int min_lines, bool counts) {
        queue_filling(stream_, job(), blocks, now, radius, min_lines, counts);
        now = 1 - now;
    };
    queue_maps(stream_, job(), static_cast<int>(map_views_.size()));
    if (request.hull) {
        queue_hull(stream_, job(), blocks);
        const int radius = fill_radius_voxels(request.hull->fill_radius_m, voxel_m);
        if (radius >= 1) fill(radius, kFillLinesOfHull, false);
    } else {
        queue_given(stream_, job(), blocks);
    }
    if (!request.colouring) return queue_bricks(stream_, job(), blocks, now);
    const ColouringOptions& options = *request.colouring;
    if (map_views_.size() > static_cast<std::size_t>(hull_views_)) queue_sharp(stream_, job(), blocks, now);
    const int radius = fill_radius_voxels(options.fill_radius_m, voxel_m);
    if (options.max_rounds > 0 && radius >= 1)
        for (int pass = 0; pass < kFillPassesOfColouring; ++pass) fill(radius, kFillLinesOfColouring, true);
    queue_views(stream_, job(), blocks, view_count(), now);
    queue_rounds(stream_, job(), blocks, view_count(), now, rounds, false, 0);
    now_after_ = (now + rounds) % 2, look_after_ = rounds + 1;
    queue_results(stream_, job(), blocks, view_count(), now_after_);
}

void VolumeMaker::queue(const VolumeRequest& request) {
    const float voxel_m = request.lattice.voxel_m;
    const auto radius_of = [&](const auto* options) {
        return options ? fill_radius_voxels(options->fill_radius_m, voxel_m) : -1;
    };
    const int rounds = request.colouring ? std::min(request.colouring->max_rounds, kMaxRounds) : -1;
    const VolumeBlocks blocks = volume_blocks();
    const std::vector<std::intptr_t> key{reinterpret_cast<std::intptr_t>(job()),
                                         static_cast<std::intptr_t>(blocks.bricks),
                                         static_cast<std::intptr_t>(blocks.cells),
                                         static_cast<std::intptr_t>(map_views_.size()),
                                         hull_views_,
                                         view_count(),
                                         radius_of(request.hull),
                                         radius_of(request.colouring),
                                         rounds};
    graph_.run(stream_, key, [&] { queue_steps(request, rounds); });
    now_ = now_after_, look_ = look_after_;
}

void VolumeMaker::fetch() {
    download(stream_, results_.data(), upload_.device<std::uint8_t>(pieces_.state), results_.size());
    stream_.wait();
}

// Whether the device needed more room than it had; then there is enough.
bool VolumeMaker::grow() {
    const VolumeRoom& needed = state().needed;
    bool grew = false;
    const auto grown = [&](int room, int needed_here) {
        if (needed_here <= room) return room;
        grew = true;
        return needed_here + needed_here / 2;
    };
    room_ = {grown(room_.bricks, needed.bricks), grown(room_.cells, needed.cells),
             grown(room_.voxels, needed.voxels)};
    return grew;
}

void VolumeMaker::take(const VolumeRequest& request, VoxelVolume& volume, ColouringReport& report) const {
    const auto* const views =
        reinterpret_cast<const ViewState*>(results_.data() + pieces_.view_states - pieces_.state);
    const auto* const bricks = reinterpret_cast<const Brick*>(results_.data() + pieces_.out - pieces_.state);
    const int count = state().bricks;
    volume.lattice = request.lattice;
    volume.bricks.clear();
    for (int n = 0; n < count; ++n) {
        std::uint64_t any = 0;
        for (std::uint64_t slice : bricks[n].occupancy) any |= slice;
        if (any) volume.bricks.push_back(bricks[n]);
    }
    const auto* const colours = reinterpret_cast<const Colour*>(bricks + count);
    volume.colours.assign(colours, colours + (request.colouring ? state().voxels : 0));
    if (!request.colouring) return;
    report.silhouette_iou.assign(views_.size(), std::numeric_limits<float>::quiet_NaN());
    for (std::size_t n = 0; n < views_.size(); ++n) {
        const unsigned long long both = views[n].counts[2];
        const unsigned long long either = views[n].counts[0] + views[n].counts[1] - both;
        if (view_masks_[n] != kNone && either > 0)
            report.silhouette_iou[n] = static_cast<float>(both) / static_cast<float>(either);
    }
}

// Adds the rounds that the device has made to the report and returns their number.
int VolumeMaker::count_rounds(int rounds, ColouringReport& report) const {
    int made = 0;
    while (made < rounds) {
        ++made;
        report.carved += static_cast<std::int64_t>(state().carved[made]);
        if (state().carved[made] == 0) break;
    }
    report.rounds += made;
    return made;
}

// Queues more rounds where the last one still carved and more are allowed; false where not.
bool VolumeMaker::queue_more(const VolumeRequest& request, ColouringReport& report) {
    const int before = report.rounds, max_rounds = request.colouring->max_rounds;
    count_rounds(std::min(max_rounds - before, kMaxRounds), report);
    const int rounds = std::min(max_rounds - report.rounds, kMaxRounds);
    if (report.rounds - before < kMaxRounds || state().carved[kMaxRounds] == 0 || rounds == 0) return false;
    const VolumeBlocks blocks = volume_blocks();
    queue_rounds(stream_, job(), blocks, view_count(), now_, rounds, true, look_);
    now_ = (now_ + rounds) % 2, look_ += rounds + 1;
    queue_results(stream_, job(), blocks, view_count(), now_);
    return true;
}

void VolumeMaker::make(const VolumeRequest& request, VoxelVolume& volume, ColouringReport& report) {
    stream_.use();
    if (in_flight_) stream_.wait();  // an error ended the last call
    in_flight_ = true;
    room_.bricks = std::max(room_.bricks, static_cast<int>(request.given.size()));
    frame(request);
    bool again = true;
    while (again) {
        place_pieces(request);
        place_memory(request);
        upload(request);
        queue(request);
        report = {};
        do {
            fetch();
            again = grow();
        } while (!again && request.colouring && queue_more(request, report));
    }
    in_flight_ = false;
    report.carved +=
        static_cast<std::int64_t>(state().carved_by_sharp) - static_cast<std::int64_t>(state().filled);
    take(request, volume, report);
}

}  // namespace kinevox::kernels::cuda
