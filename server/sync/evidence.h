// Evidence for a time shift between two cameras.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "server/sync/signals.h"

namespace kinevox::sync {

struct EvidenceOptions {
    double fps = 30;
    double pixel_px = 1;          // a 640th of the image's longer side: the unit of all scatter
    double independent_s = 0.1;   // signals further apart have independent errors
    double min_overlap_s = 0.75;  // with less, any two signals are alike: no evidence
    // Weight of signals that are only correlated against signals that are equal.
    double alike_weight = 0.5;
};

// Log likelihood ratios (nats) of: the signals belong together at this lag, against: their instants are
// unrelated. More overlap gives more evidence; constant signals give none. A lag is the second camera's
// offset minus the first one's, in frames: image n of the first camera and n - lag of the second show the
// same instant.
class PairEvidence {
  public:
    PairEvidence(PairSignals signals, const EvidenceOptions& options);

    std::size_t first() const { return signals_.first; }
    std::size_t second() const { return signals_.second; }
    bool has_equal() const { return !signals_.equal_px.empty(); }

    // Fills the table for all lags of lowest .. highest (inclusive) at which the videos overlap.
    void tabulate(int lowest, int highest);
    int lowest() const { return lowest_; }
    int highest() const { return lowest_ + static_cast<int>(table_.size()) - 1; }
    // From the table; 0 outside.
    double at(int lag) const { return covers(lag) ? table_[lag - lowest_].evidence : 0; }
    // Number of images of the first camera that have one of the second to compare with.
    int overlap(int lag) const { return covers(lag) ? table_[lag - lowest_].overlap : 0; }

    // At any lag, linear between images. Allows equal signals to differ by a constant, as with a slightly
    // wrong calibration.
    double between(double lag) const;

    // Estimates the scatter of equal signals at this lag and keeps it.
    void fix_scatter(double lag);
    // Median distance of equal signals at the lag, px of the full image; empty without any.
    std::optional<double> residual_px(double lag) const;

  private:
    struct Masked {  // value: NaN as 0; there: 1 for a value, else 0
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
