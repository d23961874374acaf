// Which of several subjects is selected, and the angle history of each. No Qt.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client/viewer/curves.h"
#include "client/viewer/shown.h"

namespace kinevox::viewer {

// While the poses show one subject at a time, that one is selected and all are one history, whatever their
// ids.
class Subjects {
  public:
    // A subject that was not seen for this time is gone: another one is selected, and it is no longer listed.
    static constexpr double kPatience_s = 5;

    void add(const ShownPoses& poses);
    void clear();

    // The subjects that are listed have different colours, up to this number.
    static constexpr std::uint32_t kColours = 8;

    // Selected by the user: stays until it is gone, and is selected again when it returns.
    void select(std::uint32_t id);
    // Selects the one after the selected in ids(), after the last one the first.
    void select_next();
    // Compared with the selected one; 0: none.
    void compare(std::uint32_t id) { compared_ = id; }

    // Two were seen at the same time within the last seconds.
    bool several() const { return several_until_ns_.has_value(); }
    std::vector<std::uint32_t> ids() const;  // seen within the last seconds
    // Empty: none.
    std::string name_of(std::uint32_t id) const;
    // Number of the colour of each in ids(), from 1: the id modulo kColours unless another one has it.
    const std::map<std::uint32_t, std::uint32_t>& colours() const { return colours_; }
    // 0: none was seen yet.
    std::uint32_t selected() const { return selected_; }
    // Empty without a comparison, or if the compared one is the selected one or gone.
    std::optional<std::uint32_t> compared() const;

    // Of the selected one.
    const AngleHistory& history() const { return history(selected_); }
    // Empty for an unknown id.
    const AngleHistory& history(std::uint32_t id) const;

  private:
    void forget(std::int64_t now_ns);
    void give_colours();
    void choose(const ShownPoses& poses);
    void add_to_histories(const ShownPoses& poses);

    std::map<std::uint32_t, std::int64_t> last_seen_ns_;
    std::map<std::uint32_t, std::string> names_;  // the latest of each in last_seen_ns_
    std::map<std::uint32_t, std::uint32_t> colours_;
    std::map<std::uint32_t, AngleHistory> histories_;  // only kSingle while there are not several
    std::optional<std::int64_t> several_until_ns_;
    std::int64_t latest_ns_ = 0;
    std::uint32_t selected_ = 0, chosen_ = 0, compared_ = 0, newest_id_ = 0;
};

// A point of the scene and the scene's size, in the same pixels; y down.
struct ScenePoint {
    double x_px = 0, y_px = 0, width_px = 0, height_px = 0;
};

// The subject drawn there; empty: none within a few pixels. `clip_from_world` of OpenGL, row major. The
// results may be null.
std::optional<std::uint32_t> subject_at(const ScenePoint& at, const std::array<double, 16>& clip_from_world,
                                        const ShownVolume* volume, const ShownPoses* poses);

}  // namespace kinevox::viewer
