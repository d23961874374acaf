// The occupied voxels of a coarse lattice over the whole scene, and to which subject each belongs.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry.h"
#include "kernels/types.h"
#include "server/pipeline/tracking/cone_box.h"

namespace kinevox {

using Cells = std::vector<std::int32_t>;  // indices in the lattice, x fastest, then y, then z

// What the cells of a body look like, m and litres, world.
struct CellStatistics {
    Vec3 centre_in_world, min_in_world, max_in_world;
    double litres = 0;
};

// Labels of all cells of a lattice. Not thread safe; keeps its memory.
class OccupiedCells {
  public:
    static constexpr std::uint8_t kEmpty = 0, kFree = 255;  // others: label of a subject, from 1

    explicit OccupiedCells(const kernels::Lattice& lattice);
    const kernels::Lattice& lattice() const { return lattice_; }

    // Whole bricks of this lattice around a box, cropped to it; without voxels if they share none.
    kernels::Lattice part_over(const Box3& box) const;

    void clear();
    // The voxels of a volume of this lattice, or of a part of it, are free. Between clear() and give().
    void add(const kernels::VoxelVolume& volume);
    // Gives the free ones among `cells`, moved by whole cells, to a subject. A cell that another subject was
    // given is contested: it becomes free again at the next flood().
    void give(const Cells& cells, const std::array<int, 3>& shift, std::uint8_t label);
    // Grows all subjects at once through the free cells, at most `max_steps` cells far.
    void flood(int max_steps);
    void free(const Cells& cells);
    bool is_free(std::int32_t cell) const { return label_[cell] == kFree; }
    std::uint8_t label_at(Vec3 in_world) const;  // kEmpty outside the lattice
    // Removes from a volume of any lattice the voxels whose centre is in a cell of another label.
    void keep(std::uint8_t label, kernels::VoxelVolume& volume) const;

    // Of the cells with this label (kFree too), parts connected by faces, edges or corners, the largest
    // first.
    std::vector<Cells> parts(std::uint8_t label) const;

    // The other subject whose cells touch a part the most, and one of these cells.
    struct Contact {
        std::uint8_t label;
        std::int32_t cell;
    };
    std::optional<Contact> largest_contact(const Cells& part) const;

    // The cells of the centres of a volume's voxels, in the order of their indices; those outside the lattice
    // are omitted.
    Cells cells_of(const kernels::VoxelVolume& volume) const;
    CellStatistics statistics(const Cells& cells) const;
    // Of a sample of the cells. A box around them is too large where a shadow on the floor belongs to them.
    double fraction_in_view(const Cells& cells, const Camera& camera) const;
    kernels::VoxelVolume volume_of(const Cells& cells) const;
    std::array<int, 3> position(std::int32_t cell) const;
    Vec3 centre_in_world(std::int32_t cell) const;
    double cell_m() const { return static_cast<double>(lattice_.voxel_m); }

  private:
    static constexpr std::uint8_t kContested = 254;

    template <class F>
    void for_each_neighbour(std::int32_t cell, F visit) const;
    int index_along(int axis, double in_world_m) const;  // -1 outside the lattice
    // Along each axis, the cell of each voxel of another lattice, as index_along().
    std::array<std::vector<int>, 3> cells_along(const kernels::Lattice& other) const;

    kernels::Lattice lattice_;
    std::vector<std::uint8_t> label_;
    Cells occupied_;
    mutable std::vector<char> visited_;
};

// Of a person who stands or walks, above the floor.
inline constexpr double kMaxUprightBottom_m = 0.5;

// Top of most people who stand, and of little furniture.
inline constexpr double kTallPerson_m = 1.3;

// In the hull, with a head.
inline constexpr double kMinTrunk_litres = 40;

// Whether a part in the air is as large as a trunk with a head: legs in the colour of the floor are missing.
bool lacks_legs(const CellStatistics& part);

// Joins parts that hang in the air with what stands below them: clothes of the background's colour divide a
// person.
void join_halves(const OccupiedCells& grid, std::vector<Cells>& parts);

// Gives a small part that is apart from the rest of its subject and touches another subject to that one: a
// hand that passed another person's head. `parts`: of each subject, as OccupiedCells::parts().
void return_limbs(OccupiedCells& grid, std::vector<std::vector<Cells>>& parts);

// The people in a part, each as its share of the cells: where the part has several trunks, the cells nearest
// to each. A part with one trunk or none is one share.
std::vector<Cells> split_by_trunks(const OccupiedCells& grid, const Cells& part);

}  // namespace kinevox
