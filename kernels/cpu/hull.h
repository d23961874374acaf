#pragma once

#include <memory>

#include "kernels/hull.h"

namespace kinevox::kernels {

std::unique_ptr<HullCarver> make_hull_carver_cpu(const HullOptions& options);

// Throws std::invalid_argument, see HullCarver::carve().
void check_lattice(const Lattice& lattice);

}  // namespace kinevox::kernels
