// Chooses one posture per frame set from several candidates: the path that explains the silhouettes with the
// least acceleration of the joints. Decided over the whole recording, so that a limb does not jump where a
// wrong candidate happens to cost less.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

struct PathCandidate {
    BodyPosture posture;
    double cost = 0;  // against the silhouettes, without motion prior
    JointPositions joints_in_world{};
    double colour_cost = 0;  // against the colours within the silhouettes
    double total() const { return cost + colour_cost; }
};

// Candidates with no joint farther apart than 3 cm are one.
bool same_joints(const PathCandidate& a, const PathCandidate& b);
// Whether a fit that approaches these joints ends at one of the candidates (kKnownJoints_m).
bool is_known(const JointPositions& joints_in_world, std::span<const PathCandidate> known);
// Whether the silhouettes prefer a candidate with the same joints.
bool is_worse(const PathCandidate& candidate, std::span<const PathCandidate> known);

struct PathFrame {
    double time_s = 0;
    std::vector<PathCandidate> candidates;  // none: the path is interrupted
};

struct PathChoice {
    int candidate = -1;  // -1: none
    // Probability of each candidate, given all frame sets; how far the choice is ambiguous.
    std::vector<double> probability;
};

// One choice per frame set; times increase.
std::vector<PathChoice> choose_path(std::span<const PathFrame> frames);

}  // namespace kinevox
