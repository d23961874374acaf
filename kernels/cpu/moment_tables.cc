#include "kernels/cpu/moment_tables.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>

namespace kinevox::kernels {
namespace {

// Adds W's real and imaginary part at (x, y), times `area`, to one cell of every function.
class CellIntegrator {
  public:
    CellIntegrator(int order, std::vector<double>& sums) : order_(order), radial_(order + 1), sums_(sums) {}

    void add(double x, double y, double area) {
        const double r = std::hypot(x, y);
        if (r > 1) return;
        const double c1 = r > 0 ? x / r : 1, s1 = r > 0 ? y / r : 0;
        double c = 1, s = 0;
        for (int q = 0; q <= order_; ++q) {
            pseudo_zernike_radial(q, order_, r, radial_.data());
            for (int p = q; p <= order_; ++p) {
                const double weighted = area * (p + 1) / std::numbers::pi * radial_[p - q];
                sums_[moment_re_index(p, q)] += weighted * c;
                if (q > 0) sums_[moment_im_index(p, q)] -= weighted * s;
            }
            const double next = c * c1 - s * s1;
            s = s * c1 + c * s1;
            c = next;
        }
    }

  private:
    int order_;
    std::vector<double> radial_;
    std::vector<double>& sums_;
};

void integrate_cell(CellIntegrator& out, int column, int row, double size) {
    const double x0 = column * size, y0 = row * size;
    if (std::hypot(x0 + size, y0 + size) <= 1) {  // Gauss-Legendre: exact up to degree 7 in each direction
        constexpr double kNodes[4] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                      0.8611363115940526};
        constexpr double kWeights[4] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                        0.3478548451374538};
        for (int j = 0; j < 4; ++j)
            for (int i = 0; i < 4; ++i)
                out.add(x0 + size * (0.5 + 0.5 * kNodes[i]), y0 + size * (0.5 + 0.5 * kNodes[j]),
                        0.25 * size * size * kWeights[i] * kWeights[j]);
        return;
    }
    constexpr int kParts = 24;  // the circle cuts this cell
    for (int j = 0; j < kParts; ++j)
        for (int i = 0; i < kParts; ++i)
            out.add(x0 + size * (i + 0.5) / kParts, y0 + size * (j + 0.5) / kParts,
                    size * size / (kParts * kParts));
}

std::shared_ptr<const MomentTables> make_tables(int order, int grid) {
    auto tables = std::make_shared<MomentTables>();
    tables->order = order;
    tables->grid = grid;
    tables->half = grid / 2;
    const double size = 2.0 / grid;
    tables->row_start.push_back(0);
    for (int row = 0; row < tables->half; ++row) {
        const double half_width = std::sqrt(std::max(0.0, 1 - (row * size) * (row * size)));
        const int cells =
            std::min((static_cast<int>(std::ceil(half_width / size)) + 7) / 8 * 8, tables->half);
        tables->row_cells.push_back(cells);
        tables->row_start.push_back(tables->row_start.back() + cells);
    }
    tables->cells = tables->row_start.back();
    int rows = 0;
    std::vector<int> row_of_value(moment_values(order));
    const auto add = [&](MomentFold fold, int value) {
        tables->functions[fold].push_back({value, rows});
        row_of_value[value] = rows++;
    };
    for (int parity = 0; parity < 2; ++parity)
        for (int q = parity; q <= order; q += 2)
            for (int p = q; p <= order; ++p) add(parity ? kCosOdd : kCosEven, moment_re_index(p, q));
    for (int parity = 0; parity < 2; ++parity)
        for (int q = parity ? 1 : 2; q <= order; q += 2)
            for (int p = q; p <= order; ++p) add(parity ? kSinOdd : kSinEven, moment_im_index(p, q));

    tables->weights.resize(static_cast<std::size_t>(rows) * tables->cells);
    std::vector<double> sums(moment_values(order));
    CellIntegrator integrator(order, sums);
    for (int row = 0; row < tables->half; ++row) {
        for (int column = 0; column < tables->row_cells[row]; ++column) {
            std::fill(sums.begin(), sums.end(), 0.0);
            integrate_cell(integrator, column, row, size);
            const std::size_t cell = static_cast<std::size_t>(tables->row_start[row]) + column;
            for (int value = 0; value < moment_values(order); ++value)
                tables->weights[static_cast<std::size_t>(row_of_value[value]) * tables->cells + cell] =
                    static_cast<float>(sums[value]);
        }
    }
    return tables;
}

}  // namespace

std::shared_ptr<const MomentTables> moment_tables(int order, int grid) {
    static std::mutex mutex;
    static std::map<std::pair<int, int>, std::shared_ptr<const MomentTables>> made;
    const std::lock_guard lock(mutex);
    std::shared_ptr<const MomentTables>& tables = made[{order, grid}];
    if (!tables) tables = make_tables(order, grid);
    return tables;
}

// R_pq(r) = r^q J_n(2 r - 1) with n = p - q and J_n Jacobi's polynomial P_n^(0, 2q+1): both are orthogonal on
// [0, 1] with the weight r and are 1 at r = 1. Its three-term recurrence never cancels there, unlike the sum
// with factorials.
void pseudo_zernike_radial(int q, int order, double r, double* out) {
    const double b = 2.0 * q + 1, x = 2 * r - 1;
    double power = 1;
    for (int n = 0; n < q; ++n) power *= r;
    double before = 0, now = power;
    for (int n = 0; n <= order - q; ++n) {
        out[n] = now;
        const double m = n + 1, s = 2 * m + b;
        const double next =
            n == 0 ? power * (1 + 0.5 * (b + 2) * (x - 1))
                   : ((s - 1) * (s * (s - 2) * x - b * b) * now - 2 * (m - 1) * (m + b - 1) * s * before) /
                         (2 * m * (m + b) * (s - 2));
        before = now;
        now = next;
    }
}

void moment_orthonormal_scale(int order, float* scale) {
    for (int p = 0; p <= order; ++p) {
        scale[moment_re_index(p, 0)] = static_cast<float>(std::sqrt(std::numbers::pi / (p + 1)));
        for (int q = 1; q <= p; ++q)  // stands for -q too
            scale[moment_re_index(p, q)] = scale[moment_im_index(p, q)] =
                static_cast<float>(std::sqrt(2 * std::numbers::pi / (p + 1)));
    }
}

}  // namespace kinevox::kernels
