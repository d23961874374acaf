// The quality of a live capture: judges the latest seconds on a thread of its own, at low priority.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "common/camera.h"
#include "server/pipeline/frame_result.h"
#include "server/pose/body_shape.h"
#include "server/quality/observer.h"
#include "server/quality/verdict.h"

namespace kinevox::quality {

struct LiveQualityOptions {
    std::chrono::nanoseconds sample_interval = std::chrono::milliseconds(500);  // capture time
    std::size_t samples = 24;                                                   // judged together
    std::size_t judge_after = 20;                                               // samples, again and again
    int max_side_px = 480;                                                      // of the reduced images
    bool several_subjects = false;   // are followed; otherwise all tracked ones are one person
    bool subjects_selected = false;  // by rules that exclude other people
};

// set_background(), observe() and report() by any thread; none blocks.
class LiveQuality {
  public:
    explicit LiveQuality(const LiveQualityOptions& options = {});
    ~LiveQuality();

    // Begins again. `background`: per camera.
    void set_background(std::vector<Camera> cameras,
                        std::shared_ptr<const std::vector<std::vector<Image>>> background);
    // Begins again with the same background.
    void set_cameras(std::vector<Camera> cameras);
    // As the segmentation's option. Begins again.
    void set_judge_faint(bool judge);
    // Each result, and the bodies it was measured with.
    void observe(const FrameResult& result, const BodyOf& body_of);
    // Null until enough was observed, and while nothing moves in the scene.
    std::shared_ptr<const QualityReport> report() const;

  private:
    struct Observed {
        FrameResult result;                         // without silhouettes and events
        std::map<std::uint32_t, BodyShape> bodies;  // by subject, 0: the next one's; empty without poses
    };
    struct Subject {
        std::deque<PosedFrame> poses;  // of the samples held
        std::optional<BodyShape> body;
    };
    void begin_again();  // with the mutex held
    void work();
    void judge_one(std::unique_ptr<Observed> one);
    void add_poses(const Observed& one);
    std::vector<PosedSubject> followed() const;

    const LiveQualityOptions options_;
    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable changed_;
    bool closing_ = false, restart_ = false, judge_faint_ = false;
    std::shared_ptr<const std::vector<Camera>> cameras_;
    std::shared_ptr<const std::vector<std::vector<Image>>> background_;
    std::unique_ptr<Observed> next_;
    std::int64_t last_time_ns_ = 0;
    std::shared_ptr<const QualityReport> report_;

    std::unique_ptr<Observer> observer_;         // these are the thread's own
    std::map<std::uint32_t, Subject> subjects_;  // by id; 0 alone if one is followed
    std::size_t since_judged_ = 0;
    std::thread thread_;
};

}  // namespace kinevox::quality
