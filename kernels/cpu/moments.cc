#include "kernels/cpu/moments.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/moment_tables.h"
#include "kernels/cpu/simd.h"
#include "kernels/shared/moments.h"

namespace kinevox::kernels {
namespace {

constexpr int kMaxGrid = 256;
constexpr int kTogether = 4;  // silhouettes that share a pass over the tables

// Sums by columns and by rows; a column's 16-bit sums are emptied before they can run over.
KINEVOX_INLINE MaskSums sum_mask_body(const MomentView& view, std::uint16_t* __restrict columns) {
    MaskSums sums;
    const Rect& box = view.bounds;
    const int width = box.width();
    for (int top = box.y0; top < box.y1; top += 256) {
        std::fill_n(columns, width, std::uint16_t{0});
        for (int y = top; y < std::min(top + 256, box.y1); ++y) {
            const std::uint8_t* __restrict row = view.mask + y * view.stride + box.x0;
            std::uint32_t row_sum = 0;
            for (int x = 0; x < width; ++x) row_sum += row[x];
            if (row_sum == 0) continue;
            for (int x = 0; x < width; ++x) columns[x] = static_cast<std::uint16_t>(columns[x] + row[x]);
            sums.mass += row_sum;
            sums.y += static_cast<std::int64_t>(row_sum) * y;
            sums.squares += static_cast<std::int64_t>(row_sum) * y * y;
        }
        for (int x = 0; x < width; ++x) {
            const std::int64_t at = x + box.x0;
            sums.x += columns[x] * at;
            sums.squares += columns[x] * at * at;
        }
    }
    return sums;
}

struct ColumnPart {
    int first = 0, last = 0;  // px, from the bounds' left edge
    float first_weight = 0, last_weight = 0;
};

// Area-weighted averages over the grid's cells, 0..1; `line` has room for the bounds' width.
KINEVOX_INLINE void resample_body(const MomentView& view, const DiskMapping& m, int grid, float* line,
                                  float* out) {
    std::memset(out, 0, sizeof(float) * grid * grid);
    const Rect& box = view.bounds;
    const float cell_px = 2 * m.radius_px / static_cast<float>(grid), scale = 1 / (255.f * cell_px * cell_px);
    const auto cells = [&](float centre, int low, int high, int& first, int& last) {
        const float corner = centre + 0.5f - m.radius_px;
        const float begin = std::floor((static_cast<float>(low) - corner) / cell_px);
        const float end = std::ceil((static_cast<float>(high) - corner) / cell_px);
        first = static_cast<int>(std::clamp(begin, 0.f, static_cast<float>(grid)));
        last = static_cast<int>(std::clamp(end, 0.f, static_cast<float>(grid)));
    };
    int row_first, row_last, column_first, column_last;
    cells(m.centre_y_px, box.y0, box.y1, row_first, row_last);
    cells(m.centre_x_px, box.x0, box.x1, column_first, column_last);
    // The columns' parts are the same in every row: whole pixels between a first and a last share.
    ColumnPart parts[kMaxGrid];
    for (int i = column_first; i < column_last; ++i) {
        const CellSpan span = cell_span(m.centre_x_px, m.radius_px, grid, i, box.x0, box.x1);
        ColumnPart& part = parts[i];
        part = {};
        if (!(span.end > span.begin)) continue;
        const int first = static_cast<int>(span.begin);
        const int last = std::min(static_cast<int>(std::ceil(span.end)), box.x1) - 1;
        part = {first - box.x0, std::max(last - box.x0, first - box.x0), scale * pixel_coverage(span, first),
                last > first ? scale * pixel_coverage(span, last) : 0.f};
    }
    const int width = box.width();
    for (int j = row_first; j < row_last; ++j) {
        const CellSpan rows = cell_span(m.centre_y_px, m.radius_px, grid, j, box.y0, box.y1);
        if (!(rows.end > rows.begin)) continue;
        std::fill_n(line, width, 0.f);
        for (int y = static_cast<int>(rows.begin); y < box.y1 && static_cast<float>(y) < rows.end; ++y) {
            const float share = pixel_coverage(rows, y);
            const std::uint8_t* __restrict row = view.mask + y * view.stride + box.x0;
            float* __restrict to = line;
            for (int x = 0; x < width; ++x) to[x] += share * static_cast<float>(row[x]);
        }
        for (int i = column_first; i < column_last; ++i) {
            const ColumnPart& part = parts[i];
            float between = 0;
            for (int x = part.first + 1; x < part.last; ++x) between += line[x];
            out[j * grid + i] =
                part.first_weight * line[part.first] + part.last_weight * line[part.last] + scale * between;
        }
    }
}

// out[fold][cell] of the quadrant's kept cells.
KINEVOX_INLINE void fold_body(const MomentTables& tables, const float* cells, float* out) {
    const int grid = tables.grid, half = tables.half;
    for (int row = 0; row < half; ++row) {
        const float* down = cells + (half + row) * grid + half;
        const float* up = cells + (half - 1 - row) * grid + half;
        float* to = out + tables.row_start[row];
        for (int column = 0; column < tables.row_cells[row]; ++column) {
            const float pp = down[column], np = down[-1 - column], pn = up[column], nn = up[-1 - column];
            for (int fold = 0; fold < kMomentFolds; ++fold)
                to[fold * tables.cells + column] = folded(fold, pp, np, pn, nn);
        }
    }
}

KINEVOX_INLINE Floats load(const float* from) {
    Floats lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

KINEVOX_INLINE float sum_lanes(const Floats& v) {
    return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

// Dot products of two functions with four silhouettes at a time: eight sums fill the pipes.
KINEVOX_INLINE void project_body(const MomentTables& tables, const float* const folds[kTogether],
                                 float* const values[kTogether]) {
    for (int fold = 0; fold < kMomentFolds; ++fold) {
        const auto& functions = tables.functions[fold];
        const float* in[kTogether];
        for (int s = 0; s < kTogether; ++s)
            in[s] = folds[s] + static_cast<std::ptrdiff_t>(fold) * tables.cells;
        for (std::size_t n = 0; n < functions.size(); n += 2) {
            const std::size_t other = std::min(n + 1, functions.size() - 1);
            const float* a =
                tables.weights.data() + static_cast<std::size_t>(functions[n].row) * tables.cells;
            const float* b =
                tables.weights.data() + static_cast<std::size_t>(functions[other].row) * tables.cells;
            Floats a0{}, a1{}, a2{}, a3{}, b0{}, b1{}, b2{}, b3{};
            for (int cell = 0; cell < tables.cells; cell += kLanes) {
                const Floats wa = load(a + cell), wb = load(b + cell);
                const Floats f0 = load(in[0] + cell), f1 = load(in[1] + cell);
                const Floats f2 = load(in[2] + cell), f3 = load(in[3] + cell);
                a0 += wa * f0, a1 += wa * f1, a2 += wa * f2, a3 += wa * f3;
                b0 += wb * f0, b1 += wb * f1, b2 += wb * f2, b3 += wb * f3;
            }
            const Floats sums_a[kTogether] = {a0, a1, a2, a3}, sums_b[kTogether] = {b0, b1, b2, b3};
            for (int s = 0; s < kTogether; ++s) {
                values[s][functions[n].value] = sum_lanes(sums_a[s]);
                values[s][functions[other].value] = sum_lanes(sums_b[s]);
            }
        }
    }
}

// The three steps, compiled for every x86-64 and for AVX2.
struct Steps {
    MaskSums (*sum)(const MomentView&, std::uint16_t*);
    void (*grid_of)(const MomentView&, const DiskMapping&, const MomentTables&, float* line, float* cells,
                    float* out);
    void (*project)(const MomentTables&, const float* const[kTogether], float* const[kTogether]);
};

MaskSums sum_plain(const MomentView& view, std::uint16_t* columns) {
    return sum_mask_body(view, columns);
}
void grid_plain(const MomentView& view, const DiskMapping& m, const MomentTables& tables, float* line,
                float* cells, float* out) {
    resample_body(view, m, tables.grid, line, cells);
    fold_body(tables, cells, out);
}
void project_plain(const MomentTables& tables, const float* const folds[kTogether],
                   float* const values[kTogether]) {
    project_body(tables, folds, values);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 MaskSums sum_avx2(const MomentView& view, std::uint16_t* columns) {
    return sum_mask_body(view, columns);
}
KINEVOX_AVX2 void grid_avx2(const MomentView& view, const DiskMapping& m, const MomentTables& tables,
                            float* line, float* cells, float* out) {
    resample_body(view, m, tables.grid, line, cells);
    fold_body(tables, cells, out);
}
KINEVOX_AVX2 void project_avx2(const MomentTables& tables, const float* const folds[kTogether],
                               float* const values[kTogether]) {
    project_body(tables, folds, values);
}
#endif

Steps choose_steps() {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return {sum_avx2, grid_avx2, project_avx2};
#endif
    return {sum_plain, grid_plain, project_plain};
}

class CpuMomentCalculator final : public MomentCalculator {
  public:
    explicit CpuMomentCalculator(const MomentOptions& options)
        : options_(options),
          steps_(choose_steps()),
          tables_(moment_tables(options.order, options.grid)),
          cells_(static_cast<std::size_t>(options.grid) * options.grid),
          unused_(moment_values(options.order)) {
        for (auto& folds : folds_) folds.assign(static_cast<std::size_t>(kMomentFolds) * tables_->cells, 0.f);
    }

    void compute(std::span<const MomentView> views, std::vector<SilhouetteMoments>& out) override {
        out.resize(views.size());
        waiting_ = 0;
        for (std::size_t n = 0; n < views.size(); ++n) {
            out[n].values.assign(moment_values(options_.order), 0.f);
            if (!prepare(views[n], out[n])) continue;
            values_[waiting_++] = out[n].values.data();
            if (waiting_ == kTogether) project();
        }
        project();
    }

  private:
    bool prepare(const MomentView& view, SilhouetteMoments& out) {
        MaskSums sums;
        const bool any = view.mask && !view.bounds.empty();
        if (any) {
            columns_.resize(view.bounds.width());
            line_.resize(view.bounds.width());
            sums = steps_.sum(view, columns_.data());
        }
        if (!map_to_disk(sums, view, options_.disk_per_gyration, out)) return false;
        steps_.grid_of(view, out.mapping, *tables_, line_.data(), cells_.data(), folds_[waiting_].data());
        return true;
    }

    void project() {
        if (waiting_ == 0) return;
        const float* folds[kTogether];
        for (int s = 0; s < kTogether; ++s) {
            folds[s] = folds_[s].data();
            if (s >= waiting_) values_[s] = unused_.data();
        }
        steps_.project(*tables_, folds, values_.data());
        waiting_ = 0;
    }

    MomentOptions options_;
    Steps steps_;
    std::shared_ptr<const MomentTables> tables_;
    std::vector<std::uint16_t> columns_;
    std::vector<float> line_, cells_, unused_;
    std::array<cpu::AlignedVector<float>, kTogether> folds_;
    std::array<float*, kTogether> values_{};
    int waiting_ = 0;  // silhouettes folded but not yet projected
};

}  // namespace

bool map_to_disk(const MaskSums& sums, const MomentView& view, float disk_per_gyration,
                 SilhouetteMoments& out) {
    out.mass_px = static_cast<double>(sums.mass) / 255;
    out.mapping = {};
    if (view.mapping) {
        const DiskMapping& m = *view.mapping;
        if (!(m.radius_px > 0) || !std::isfinite(m.radius_px + m.centre_x_px + m.centre_y_px))
            throw std::invalid_argument("moments: a mapping needs a positive radius and finite numbers");
    }
    if (!(view.radius_px >= 0) || !std::isfinite(view.radius_px))
        throw std::invalid_argument("moments: a given radius must be finite and not negative");
    if (sums.mass <= 0) return false;
    if (view.mapping) {
        out.mapping = *view.mapping;
        return true;
    }
    const double mass = static_cast<double>(sums.mass);
    const double x = static_cast<double>(sums.x) / mass, y = static_cast<double>(sums.y) / mass;
    if (view.radius_px > 0) {
        out.mapping = {static_cast<float>(x), static_cast<float>(y), view.radius_px};
        return true;
    }
    // A pixel is a square: 1/12 px^2 in each direction more than its centre's place.
    const double mean_square = static_cast<double>(sums.squares) / mass - x * x - y * y + 1.0 / 6.0;
    out.mapping = {static_cast<float>(x), static_cast<float>(y),
                   static_cast<float>(disk_per_gyration * std::sqrt(std::max(mean_square, 1.0 / 6.0)))};
    return true;
}

std::unique_ptr<MomentCalculator> make_moment_calculator_cpu(const MomentOptions& options) {
    return std::make_unique<CpuMomentCalculator>(options);
}

}  // namespace kinevox::kernels
