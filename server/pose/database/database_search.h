// Which poses of a database look like what the cameras see.
//
// Per camera: the silhouette is brought to the aimed camera (aimed_view.h), described by its moments about
// its own centre of gravity at a metric size, and compared with the views of the nearest viewpoint. A
// record's distance is the root mean square over the cameras of the difference of the silhouettes
// (moment_orthonormal_scale(): the square root of the area in which they differ, in units of the disk's
// radius).
//
// A silhouette that is empty, that is larger than any person's or that the picture's border cuts does not
// take part; neither does an absent one. Without any camera left there are no candidates.
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
    kAll,         // codes of all entries, the best of them by all moments
    kPublished,   // paper, section 4: the n entries nearest by the first moment, of these by all moments
    kExhaustive,  // all moments of all entries: the reference, slow
};

struct SearchOptions {
    RetrievalRule rule = RetrievalRule::kAll;
    int neighbourhood = 1000;  // of the published rule: n
    int reranked = 60;         // of the best by codes, compared by all moments
    double stature_m = 0;      // of the subject, where known; 0: the database's
};

enum class SilhouetteUse { kUsed, kAbsent, kEmpty, kFull, kCut };

struct FoundPose {
    int pose = 0, heading = 0;  // heading: steps of 360 / kHeadings deg
    double distance = 0;
};

// Not thread safe; the database must outlive it and not change.
class DatabaseSearch final : public PoseProposer {
  public:
    explicit DatabaseSearch(const PoseDatabase& database, const SearchOptions& options = {});

    std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                       int most) override;

    // The steps of propose(), for tests and benchmarks. look() returns how many cameras take part.
    int look(std::span<const PoseView> views, Vec3 centre_in_world);
    std::vector<FoundPose> find(int most);
    // Where find()'s pose has to stand so that the silhouettes' middles lie where they were seen.
    PoseCandidate place(const FoundPose& found) const;

    // Of the last look(), per camera.
    const std::vector<SilhouetteUse>& uses() const { return uses_; }

  private:
    struct Seen {
        AimedView view;
        int slab = 0;
        double first_bin = 0;        // where heading 0 falls among the bins
        std::vector<float> moments;  // scaled
        std::uint8_t code[kernels::kCodeBytes];
        double middle_right_m = 0, middle_down_m = 0;  // of the silhouette from the view's middle
    };
    struct Between {  // two neighbouring bins and the share of the second
        int a, b;
        float share;
    };

    SilhouetteUse judge(const AimedSilhouette& silhouette) const;
    static Between bins(const Seen& seen, int heading);
    float exact_distance(int pose, int heading) const;
    void turn_to_nearest(FoundPose& found) const;
    void score_all();
    std::vector<FoundPose> best_by_codes(int count);
    std::vector<FoundPose> nearest_by_first_moment() const;

    const PoseDatabase& database_;
    SearchOptions options_;
    double scale_;  // of the subject against the database's body
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
