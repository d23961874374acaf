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

// For each frame set, how probable it is that the legs of the chosen posture are exchanged from one crossing
// to the next. A path accounts for costs as if they were independent; those of such a run err alike. 0 where
// no candidate has the legs exchanged, which is so in nearly all frame sets.
std::vector<double> exchanged_legs_probability(std::span<const PathFrame> frames,
                                               std::span<const PathChoice> choices);

}  // namespace kinevox
