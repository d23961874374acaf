// What places from a board and from a wand share: moments, and what each camera saw in them.
#pragma once

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "server/calibration/coverage.h"
#include "server/calibration/procedure_works.h"

namespace kinevox {

class PlaceWork : public ProcedureWork {
  public:
    PlaceWork(std::vector<Camera> cameras, std::vector<std::size_t> chosen)
        : cameras_(std::move(cameras)), chosen_(std::move(chosen)) {
        for (const std::size_t c : chosen_) {
            lenses_.push_back(cameras_[c]);
            coverage_.emplace_back(cameras_[c].width, cameras_[c].height);
            seen_.emplace_back().name = cameras_[c].name;
        }
    }

    ProcedureReport report() const override {
        ProcedureReport report;
        report.cameras = seen_;
        for (std::size_t i = 0; i < chosen_.size(); ++i) {
            report.cameras[i].coverage = coverage_[i].part();
            report.cameras[i].coverage_counts = coverage_[i].counts();
        }
        report.moments = shared_moments_;
        report.full = kept_moments_ >= kMaxViews;
        return report;
    }

  protected:
    // The number of the next live moment, and room for so many pictures of a clip. Live moments lie apart, so
    // that nobody takes two of them for neighbours in time.
    int next_moment() { return std::exchange(next_moment_, next_moment_ + 2); }
    int next_moments(int count) { return std::exchange(next_moment_, next_moment_ + count + 2); }

    int index_of(const std::string& camera) const {
        for (std::size_t i = 0; i < seen_.size(); ++i)
            if (seen_[i].name == camera) return static_cast<int>(i);
        return -1;
    }

    void accept(int index, const std::vector<Vec2>& pixels) {
        seen_[index].seen_last = true;
        ++seen_[index].accepted;
        for (const Vec2 pixel : pixels) coverage_[index].add(pixel);
    }

    // After each moment: how many cameras saw it.
    void count_moment(int seen_by) {
        kept_moments_ += seen_by > 0;
        shared_moments_ += seen_by > 1;
    }
    // What was seen in clips, cameras side by side, as found[clip][picture]: `add(moment, camera's index,
    // what)` says whether it can be used. The moment of each picture, counted in the clips, that two cameras
    // or more saw.
    template <class Found, class Add>
    std::map<int, int> add_clips(const ProcedureFiles& files, const std::vector<std::vector<Found>>& found,
                                 Add add) {
        std::size_t longest = 0;
        for (const auto& clip : found) longest = std::max(longest, clip.size());
        const int first = next_moments(static_cast<int>(longest) * files.every);
        std::map<int, int> shared;
        for (std::size_t i = 0; i < longest; ++i) {
            const int picture = static_cast<int>(i) * files.every;
            int seen_by = 0;
            for (std::size_t clip = 0; clip < found.size(); ++clip)
                if (i < found[clip].size())
                    seen_by += add(first + picture, index_of(files.clips[clip].camera), found[clip][i]);
            count_moment(seen_by);
            if (seen_by > 1) shared.emplace(picture, first + picture);
        }
        return shared;
    }
    bool has_room() const { return kept_moments_ < kMaxViews; }

    std::vector<Camera> cameras_;
    std::vector<std::size_t> chosen_;
    std::vector<Camera> lenses_;        // of those chosen
    std::vector<ObservedCamera> seen_;  // the same
    std::vector<Coverage> coverage_;    // the same

  private:
    int next_moment_ = 0, kept_moments_ = 0, shared_moments_ = 0;
};

}  // namespace kinevox
