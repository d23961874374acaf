// Retrieves the poses of a database that resemble the current silhouettes.
//
// Per camera, the silhouette is rectified to the aimed camera (aimed_view.h), described by its moments about
// its centroid at metric scale, and compared with the views of the nearest viewpoint. The distance of an
// entry is the root mean square over the cameras of the silhouette difference (moment_orthonormal_scale():
// the square root of the differing area in units of the disk's radius).
//
// Excludes absent, empty and truncated silhouettes and those larger than any person's. Without a usable
// camera there are no candidates.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/moments.h"
#include "server/pose/database/aimed_view.h"
#include "server/pose/database/pose_database.h"
#include "server/pose/pose_candidate.h"

namespace kinevox {

enum class RetrievalRule {
    kAll,         // codes of all entries, the best of them compared by all moments
    kPublished,   // paper, section 4: the n entries nearest by the first moment, compared by all moments
    kExhaustive,  // all moments of all entries: the reference, slow
};

struct SearchOptions {
    RetrievalRule rule = RetrievalRule::kAll;
    int neighbourhood = 1000;  // n of the published rule
    int reranked = 60;         // number of the best by codes that are compared by all moments
    double stature_m = 0;      // of the subject; 0: that of the database
};

enum class SilhouetteUse { kUsed, kAbsent, kEmpty, kTooLarge, kTruncated };

struct FoundPose {
    int pose = 0, heading = 0;  // heading: steps of 360 / kHeadings deg
    double distance = 0;
};

// Not thread-safe; the database must outlive it unchanged.
class DatabaseSearch final : public PoseProposer {
  public:
    explicit DatabaseSearch(const PoseDatabase& database, const SearchOptions& options = {});

    std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                       int max_candidates) override;

    // The steps of propose(), for tests and benchmarks. describe() returns the number of cameras used.
    int describe(std::span<const PoseView> views, Vec3 centre_in_world);
    std::vector<FoundPose> find(int max_candidates);
    // Positions a found pose so that its silhouettes' centres match the observed ones.
    PoseCandidate place(const FoundPose& found) const;

    // Per camera, of the last describe().
    const std::vector<SilhouetteUse>& uses() const { return uses_; }

  private:
    struct Seen {
        AimedView view;
        int slab = 0;
        double first_bin = 0;        // where heading 0 falls among the bins
        std::vector<float> moments;  // scaled
        std::uint8_t code[kernels::kCodeBytes];
        double centre_right_m = 0, centre_down_m = 0;  // of the silhouette from the view's centre
    };
    struct Blend {  // two neighbouring bins and the weight of the second
        int a, b;
        float weight;
    };

    SilhouetteUse judge(const AimedSilhouette& silhouette) const;
    static Blend bins(const Seen& seen, int heading);
    float exact_distance(int pose, int heading) const;
    void refine_heading(FoundPose& found) const;
    void score_all();
    std::vector<FoundPose> best_by_codes(int count);
    std::vector<FoundPose> nearest_by_first_moment() const;

    const PoseDatabase& database_;
    SearchOptions options_;
    double scale_;  // of the subject relative to the database's body
    std::unique_ptr<kernels::MomentCalculator> calculator_;
    std::vector<float> moment_scale_;
    std::vector<SilhouetteUse> uses_;
    std::vector<Seen> seen_;
    Vec3 centre_;
    std::vector<AimedSilhouette> aimed_;
    std::vector<kernels::SilhouetteMoments> described_;
    std::vector<float> scores_;
    std::vector<std::vector<std::pair<float, int>>> by_first_moment_;  // per slab: moment, view; sorted
};

}  // namespace kinevox
