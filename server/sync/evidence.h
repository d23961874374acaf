// How much two cameras' signals speak for a shift between them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "server/sync/signals.h"

namespace kinevox::sync {

struct EvidenceOptions {
    double fps = 30;
    double pixel_px = 1;          // a 640th of the picture's longer side: the unit of all scatter
    double independent_s = 0.1;   // signals that far apart err independently of each other
    double min_overlap_s = 0.75;  // in less, signals of anything are alike: nothing speaks for such a shift
    // Signals that only rise and fall together count so much against those that are equal.
    double alike_weight = 0.5;
};

// Logarithms of likelihood ratios (nats): the signals belong together at this lag, against: their instants
// have nothing to do with each other. More overlap, more evidence; signals that stay as they are give none. A
// lag is the second camera's offset less the first one's, in frames: the first one's picture n and the second
// one's n - lag show the same instant.
class PairEvidence {
  public:
    PairEvidence(PairSignals signals, const EvidenceOptions& options);

    std::size_t first() const { return signals_.first; }
    std::size_t second() const { return signals_.second; }
    bool has_equal() const { return !signals_.equal_px.empty(); }

    // For all lags of lowest .. highest, both included, at which the videos overlap.
    void tabulate(int lowest, int highest);
    int lowest() const { return lowest_; }
    int highest() const { return lowest_ + static_cast<int>(table_.size()) - 1; }
    // From the table; nothing beyond it.
    double at(int lag) const { return covers(lag) ? table_[lag - lowest_].evidence : 0; }
    // How many pictures of the first camera had one of the second to be compared with.
    int overlap(int lag) const { return covers(lag) ? table_[lag - lowest_].overlap : 0; }

    // At any lag, linear between pictures. Lets equal signals differ by a constant as calibrations do that
    // are not quite right.
    double between(double lag) const;

    // The scatter of equal signals is taken from this lag, where they are believed to belong together.
    void settle(double lag);
    // Median distance of equal signals there, px of the full picture; nothing without any.
    std::optional<double> miss_px(double lag) const;

  private:
    struct Masked {  // NaN as 0, and where there is a value: 0 or 1
        std::vector<double> value, there;
    };
    struct Entry {
        double evidence = 0;
        int overlap = 0;
    };
    bool covers(int lag) const { return lag >= lowest_ && lag <= highest(); }
    void measure_chance();
    Entry whole(int lag) const;
    std::vector<double> distances_px(std::size_t signal, double lag) const;
    double alike_evidence(double n, double x, double y, double xx, double yy, double xy) const;

    PairSignals signals_;
    EvidenceOptions options_;
    double independent_;              // frames
    std::vector<double> scatter_px_;  // of each equal signal
    std::vector<double> chance_;      // its mean log likelihood at unrelated instants
    std::vector<std::array<Masked, 2>> equal_, alike_;
    int lowest_ = 0;
    std::vector<Entry> table_;
};

}  // namespace kinevox::sync
