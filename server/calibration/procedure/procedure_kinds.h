// The kinds of ProcedureWork and what they share.
#pragma once

#include <algorithm>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "server/calibration/coverage.h"
#include "server/calibration/procedure/procedure_work.h"

namespace kinevox {

using ProcedureWorkOr = absl::StatusOr<std::unique_ptr<ProcedureWork>>;

// `chosen`: indices of the participating cameras, increasing.
ProcedureWorkOr make_intrinsics_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                     const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_board_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_wand_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                               const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_person_work(const ProcedureRequest& request, const std::vector<Camera>& cameras);

// Checks names, paths and sizes of clips; fills in the sizes.
absl::Status check_clips(const std::vector<Camera>& cameras, std::span<const std::size_t> chosen,
                         ProcedureFiles& files);

// The same for the kinds without a board on the floor.
absl::Status check_clips_without_floor(const std::vector<Camera>& cameras,
                                       std::span<const std::size_t> chosen, ProcedureFiles& files);

// Counts a rejected view; `message` for the operator, empty for the usual case.
void reject_view(CameraObservations& camera, const std::string& why, const std::string& in_words);

// Base of the extrinsics procedures with a board and a wand: frame sets and detections per camera.
class TargetExtrinsicsWork : public ProcedureWork {
  public:
    TargetExtrinsicsWork(std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : cameras_(std::move(cameras)), chosen_(std::move(chosen)) {
        for (const std::size_t c : chosen_) {
            intrinsics_.push_back(cameras_[c]);
            coverage_.emplace_back(cameras_[c].width, cameras_[c].height);
            seen_.emplace_back().name = cameras_[c].name;
        }
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.cameras = seen_;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            report.cameras[i].coverage = coverage_[i].fraction();
            report.cameras[i].coverage_counts = coverage_[i].counts();
        }
        report.shared_frame_set_count = shared_frame_sets_;
        report.full = kept_frame_sets_ >= kMaxViews;
        return report;
    }

  protected:
    // Number of the next live frame set, and a range of numbers for the images of a clip. Live numbers are
    // never consecutive: consecutive means adjacent in time.
    int next_frame_set() { return std::exchange(next_frame_set_, next_frame_set_ + 2); }
    int next_frame_sets(int count) { return std::exchange(next_frame_set_, next_frame_set_ + count + 2); }

    int index_of(const std::string& camera) const {
        for (std::size_t i = 0; i < seen_.size(); ++i)
            if (seen_[i].name == camera) return static_cast<int>(i);
        return -1;
    }

    void accept(int index, const std::vector<Vec2>& pixels) {
        seen_[index].detected_in_latest = true;
        ++seen_[index].accepted_count;
        for (const Vec2 pixel : pixels) coverage_[index].add(pixel);
    }

    // After each frame set: the number of cameras with a detection.
    void count_frame_set(int seen_by) {
        kept_frame_sets_ += seen_by > 0;
        shared_frame_sets_ += seen_by > 1;
    }
    // Adds detections of clips, found[clip][image]: `add(frame set, camera index, detection)` returns whether
    // it is usable. Returns the frame set of each image, counted in the clips, that two or more cameras
    // share.
    template <class Found, class Add>
    std::map<int, int> add_clips(const ProcedureFiles& files, const std::vector<std::vector<Found>>& found,
                                 Add add) {
        std::size_t longest = 0;
        for (const auto& clip : found) longest = std::max(longest, clip.size());
        const int first = next_frame_sets(static_cast<int>(longest) * files.stride);
        std::map<int, int> shared;
        for (std::size_t i = 0; i < longest; ++i) {
            const int image = static_cast<int>(i) * files.stride;
            int seen_by = 0;
            for (std::size_t clip = 0; clip < found.size(); ++clip)
                if (i < found[clip].size())
                    seen_by += add(first + image, index_of(files.clips[clip].camera), found[clip][i]);
            count_frame_set(seen_by);
            if (seen_by > 1) shared.emplace(image, first + image);
        }
        return shared;
    }
    bool has_room() const { return kept_frame_sets_ < kMaxViews; }

    std::vector<Camera> cameras_;
    std::vector<std::size_t> chosen_;
    std::vector<Camera> intrinsics_;        // of the chosen cameras
    std::vector<CameraObservations> seen_;  // the same
    std::vector<Coverage> coverage_;        // the same

  private:
    int next_frame_set_ = 0, kept_frame_sets_ = 0, shared_frame_sets_ = 0;
};

}  // namespace kinevox
