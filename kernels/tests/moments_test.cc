// Moments: the basis in extended precision, known shapes against their integrals, invariance and
// reconstruction.
#include "kernels/moments.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <complex>
#include <functional>
#include <numbers>
#include <random>
#include <stdexcept>

#include "kernels/tests/moment_shapes.h"

namespace kinevox::kernels {
namespace {

using testing::draw_figure;
using testing::draw_shape;
using testing::ShapeMask;
constexpr double kPi = std::numbers::pi;

#if defined(__SIZEOF_FLOAT128__)
__extension__ typedef __float128 Quad;
#else
typedef long double Quad;
#endif

// The definition with factorials: at order 20 its terms grow to 1e15, too large for cancellation in double.
double radial_by_definition(int p, int q, double r) {
    const auto factorial = [](int n) {
        Quad f = 1;
        for (int i = 2; i <= n; ++i) f *= i;
        return f;
    };
    Quad sum = 0;
    for (int s = 0; s <= p - q; ++s) {
        Quad power = 1;
        for (int i = 0; i < p - s; ++i) power *= static_cast<Quad>(r);
        const Quad term = factorial(2 * p + 1 - s) /
                          (factorial(s) * factorial(p - q - s) * factorial(p + q + 1 - s)) * power;
        sum += s % 2 ? -term : term;
    }
    return static_cast<double>(sum);
}

std::complex<double> moment(const SilhouetteMoments& m, int p, int q) {
    return {m.values[moment_re_index(p, q)], q == 0 ? 0.0 : m.values[moment_im_index(p, q)]};
}

SilhouetteMoments moments_of(const MomentView& view, const MomentOptions& options = {}) {
    std::vector<SilhouetteMoments> out;
    make_moment_calculator(Device::kCpu, options)->compute(std::span(&view, 1), out);
    return out[0];
}

// integral of f(r) r over [a, b], Simpson with many steps.
double integrate(double a, double b, const std::function<double(double)>& f) {
    constexpr int kSteps = 4000;
    double sum = 0;
    for (int n = 0; n <= kSteps; ++n) {
        const double r = a + (b - a) * n / kSteps;
        sum += (n == 0 || n == kSteps ? 1 : (n % 2 ? 4 : 2)) * f(r) * r;
    }
    return sum * (b - a) / kSteps / 3;
}

double radial(int p, int q, double r) {
    double values[kMaxMomentOrder + 1];
    pseudo_zernike_radial(q, p, r, values);
    return values[p - q];
}

TEST(MomentBasis, RecurrenceMatchesDefinitionInExtendedPrecision) {
    double worst = 0;
    for (int p = 0; p <= kMaxMomentOrder; ++p)
        for (int q = 0; q <= p; ++q)
            for (double r = 0; r <= 1.0; r += 1.0 / 64)
                worst = std::max(worst, std::fabs(radial(p, q, r) - radial_by_definition(p, q, r)));
    EXPECT_LT(worst, 1e-13);
}

TEST(MomentBasis, IsOrthogonal) {
    // The angles' part is exact; the radial part integral R_pq R_nq r dr = delta / (2 (p + 1)).
    for (int q : {0, 1, 2, 5, 11, 20})
        for (int p = q; p <= kMaxMomentOrder; ++p)
            for (int n = q; n <= kMaxMomentOrder; ++n)
                EXPECT_NEAR(integrate(0, 1, [&](double r) { return radial(p, q, r) * radial(n, q, r); }),
                            p == n ? 1 / (2.0 * (p + 1)) : 0, 1e-8)
                    << p << " " << n << " " << q;
}

TEST(Moments, FullDiskMatchesIntegral) {
    const ShapeMask mask = draw_shape(300, 300, [](double, double) { return true; });
    const SilhouetteMoments m = moments_of(mask.view({150, 150, 130}), {.order = 20});
    for (int p = 0; p <= 20; ++p)
        for (int q = 0; q <= p; ++q)
            EXPECT_LT(std::abs(moment(m, p, q) - (p == 0 ? 1.0 : 0.0)), 2e-3) << p << " " << q;
}

TEST(Moments, SmallerDiskMatchesIntegral) {
    const double radius = 0.62;
    const ShapeMask mask =
        draw_shape(401, 401, [&](double x, double y) { return std::hypot(x - 200, y - 200) < radius * 180; });
    const SilhouetteMoments m = moments_of(mask.view({200, 200, 180}), {.order = 12});
    const SilhouetteMoments fine = moments_of(mask.view({200, 200, 180}), {.order = 12, .grid = 256});
    for (int p = 0; p <= 12; ++p) {
        const double expected = 2 * (p + 1) * integrate(0, radius, [&](double r) { return radial(p, 0, r); });
        EXPECT_NEAR(moment(m, p, 0).real(), expected, 1e-2) << p;
        EXPECT_NEAR(moment(fine, p, 0).real(), expected, 2e-3) << p;
        for (int q = 1; q <= p; ++q) EXPECT_LT(std::abs(moment(m, p, q)), 5e-3) << p << " " << q;
    }
}

TEST(Moments, HalfDiskMatchesIntegral) {
    const ShapeMask mask = draw_shape(401, 401, [](double x, double) { return x > 200; });
    const SilhouetteMoments m = moments_of(mask.view({200, 200, 180}), {.order = 12});
    for (int p = 0; p <= 12; ++p) {
        for (int q = 0; q <= p; ++q) {
            const double angle = q == 0 ? kPi : 2 * std::sin(q * kPi / 2) / q;
            const double expected =
                (p + 1) / kPi * angle * integrate(0, 1, [&](double r) { return radial(p, q, r); });
            EXPECT_LT(std::abs(moment(m, p, q) - expected), 4e-3) << p << " " << q;
        }
    }
}

TEST(Moments, RectangleMatchesNumericIntegration) {
    const double x0 = -0.5, x1 = 0.3, y0 = -0.2, y1 = 0.55;
    const ShapeMask mask = draw_shape(401, 401, [&](double u, double v) {
        const double x = (u - 200) / 180, y = (v - 200) / 180;
        return x > x0 && x < x1 && y > y0 && y < y1;
    });
    const SilhouetteMoments m = moments_of(mask.view({200, 200, 180}), {.order = 10});
    constexpr int kSteps = 400;
    for (int p = 0; p <= 10; ++p) {
        for (int q = 0; q <= p; ++q) {
            std::complex<double> sum = 0;
            for (int j = 0; j < kSteps; ++j)
                for (int i = 0; i < kSteps; ++i) {
                    const double x = x0 + (x1 - x0) * (i + 0.5) / kSteps,
                                 y = y0 + (y1 - y0) * (j + 0.5) / kSteps;
                    sum += radial(p, q, std::hypot(x, y)) * std::polar(1.0, -q * std::atan2(y, x));
                }
            sum *= (p + 1) / kPi * (x1 - x0) * (y1 - y0) / (kSteps * kSteps);
            EXPECT_LT(std::abs(moment(m, p, q) - sum), 3e-3) << p << " " << q;
        }
    }
}

TEST(Moments, MappingIsCentroidAndRadiusOfGyration) {
    const ShapeMask mask = draw_shape(200, 150, [](double x, double y) {
        return x > 39.5 && x < 99.5 && y > 29.5 && y < 109.5;  // 60 x 80 px
    });
    const SilhouetteMoments m = moments_of(mask.view(), {.disk_per_gyration = 2});
    EXPECT_NEAR(m.mass_px, 4800, 1e-6);
    EXPECT_NEAR(m.mapping.centre_x_px, 69.5, 1e-4);
    EXPECT_NEAR(m.mapping.centre_y_px, 69.5, 1e-4);
    EXPECT_NEAR(m.mapping.radius_px, 2 * std::sqrt((60 * 60 + 80 * 80) / 12.0), 1e-3);
    EXPECT_NEAR(m.values[0], 4800 / (kPi * m.mapping.radius_px * m.mapping.radius_px), 1e-3);
}

TEST(Moments, AcceptsGivenRadiusOnly) {
    const ShapeMask mask = draw_figure(300, 300, 140, 160, 90);
    MomentView view = mask.view();
    view.radius_px = 130;
    const SilhouetteMoments given = moments_of(view), own = moments_of(mask.view());
    EXPECT_EQ(given.mapping.centre_x_px, own.mapping.centre_x_px);
    EXPECT_EQ(given.mapping.radius_px, 130);
    EXPECT_EQ(given.values, moments_of(mask.view(given.mapping)).values);
    view.radius_px = -1;
    EXPECT_THROW(moments_of(view), std::invalid_argument);
}

TEST(Moments, AreInvariantToTranslationAndScale) {
    const MomentOptions options{.order = 12};
    const SilhouetteMoments here = moments_of(draw_figure(640, 480, 200, 240, 120).view(), options);
    const SilhouetteMoments there = moments_of(draw_figure(640, 480, 401.3, 200.6, 71.7).view(), options);
    EXPECT_NEAR(there.mapping.radius_px / here.mapping.radius_px, 71.7 / 120, 1e-3);
    for (int n = 0; n < moment_values(12); ++n) EXPECT_NEAR(here.values[n], there.values[n], 0.012) << n;
    EXPECT_GT(std::abs(moment(here, 3, 1)), 0.05);
}

TEST(Moments, RotationChangesOnlyPhase) {
    const MomentOptions options{.order = 10};
    const SilhouetteMoments upright = moments_of(draw_figure(480, 480, 240, 240, 150).view(), options);
    for (double turn : {0.3, 1.1, 2.5, -1.8}) {
        const SilhouetteMoments turned =
            moments_of(draw_figure(480, 480, 240, 240, 150, turn).view(), options);
        for (int p = 0; p <= 10; ++p)
            for (int q = 0; q <= p; ++q)
                EXPECT_LT(std::abs(moment(turned, p, q) - moment(upright, p, q) * std::polar(1.0, -q * turn)),
                          0.006)
                    << p << " " << q << " turned by " << turn;
    }
}

// The silhouette described by moments, sampled at the centres of grid x grid cells of the disk's square; 0
// outside the disk.
std::vector<float> reconstruct_from_moments(std::span<const float> values, int order, int grid) {
    std::vector<float> out(static_cast<std::size_t>(grid) * grid, 0.f);
    double radial[kMaxMomentOrder + 1];
    for (int row = 0; row < grid; ++row) {
        for (int column = 0; column < grid; ++column) {
            const double x = (2 * column + 1.0) / grid - 1, y = (2 * row + 1.0) / grid - 1;
            const double r = std::hypot(x, y), theta = std::atan2(y, x);
            if (r > 1) continue;
            double sum = 0;
            for (int q = 0; q <= order; ++q) {
                pseudo_zernike_radial(q, order, r, radial);
                double re = 0, im = 0;
                for (int p = q; p <= order; ++p) {
                    re += radial[p - q] * values[moment_re_index(p, q)];
                    if (q > 0) im += radial[p - q] * values[moment_im_index(p, q)];
                }
                sum += q == 0 ? re : 2 * (re * std::cos(q * theta) - im * std::sin(q * theta));
            }
            out[static_cast<std::size_t>(row) * grid + column] = static_cast<float>(sum);
        }
    }
    return out;
}

TEST(Moments, ReconstructionImprovesWithOrder) {
    const ShapeMask mask = draw_figure(480, 480, 240, 240, 150);
    double before = 1e9;
    for (int order : {2, 4, 8, 12, 16, 20}) {
        const SilhouetteMoments m = moments_of(mask.view(), {.order = order});
        constexpr int kGrid = 96;
        const std::vector<float> image = reconstruct_from_moments(m.values, order, kGrid);
        double error = 0;
        int wrong = 0, set = 0;
        for (int row = 0; row < kGrid; ++row) {
            for (int column = 0; column < kGrid; ++column) {
                const double x = (2 * column + 1.0) / kGrid - 1, y = (2 * row + 1.0) / kGrid - 1;
                if (std::hypot(x, y) > 1) continue;
                const bool truth = testing::figure_distance(
                                       (m.mapping.centre_x_px + x * m.mapping.radius_px - 240) / 150,
                                       (m.mapping.centre_y_px + y * m.mapping.radius_px - 240) / 150) < 0;
                const double value = image[row * kGrid + column];
                error += (value - truth) * (value - truth);
                wrong += (value > 0.5) != truth;
                set += truth;
            }
        }
        EXPECT_LT(error, 0.97 * before) << "order " << order;
        before = error;
        if (order == 20) {
            EXPECT_LT(wrong, 0.15 * set);
        }
    }
}

TEST(Moments, ScaledDistanceIsSilhouetteDifference) {
    // Two smooth blobs: all of their difference lies below order 20.
    const auto blob = [](double x0) {
        ShapeMask mask{200, 200, std::vector<std::uint8_t>(200 * 200)};
        for (int y = 0; y < 200; ++y)
            for (int x = 0; x < 200; ++x)
                mask.pixels[y * 200 + x] = static_cast<std::uint8_t>(
                    std::lround(255 * std::exp(-((x - x0) * (x - x0) + (y - 90) * (y - 90)) / 1000)));
        return mask;
    };
    const ShapeMask a = blob(90), b = blob(105);
    double expected = 0;
    for (std::size_t n = 0; n < a.pixels.size(); ++n)
        expected += std::pow((a.pixels[n] - b.pixels[n]) / 255.0 / 90, 2);
    const SilhouetteMoments ma = moments_of(a.view({100, 100, 90}), {.order = 20});
    const SilhouetteMoments mb = moments_of(b.view({100, 100, 90}), {.order = 20});
    std::vector<float> scale(moment_values(20));
    moment_orthonormal_scale(20, scale.data());
    double sum = 0;
    for (int n = 0; n < moment_values(20); ++n) sum += std::pow((ma.values[n] - mb.values[n]) * scale[n], 2);
    EXPECT_NEAR(sum, expected, 0.01 * expected);
}

TEST(Moments, LowerOrderIsPrefixOfHigherOrder) {
    const ShapeMask mask = draw_figure(300, 300, 150, 150, 90);
    const SilhouetteMoments low = moments_of(mask.view(), {.order = 6}),
                            high = moments_of(mask.view(), {.order = 20});
    for (int n = 0; n < moment_values(6); ++n) EXPECT_NEAR(low.values[n], high.values[n], 1e-6f);
}

TEST(Moments, SameBitsWithAnyOtherViews) {
    std::vector<ShapeMask> masks;
    for (int n = 0; n < 7; ++n)
        masks.push_back(draw_figure(200, 200, 90 + 3 * n, 100 - n, 60 + 2 * n, 0.2 * n));
    std::vector<MomentView> views;
    for (const ShapeMask& mask : masks) views.push_back(mask.view());
    views.insert(views.begin() + 2, MomentView{});  // a camera without a silhouette
    auto calculator = make_moment_calculator(Device::kCpu);
    std::vector<SilhouetteMoments> all, again;
    calculator->compute(views, all);
    calculator->compute(views, again);
    for (std::size_t n = 0; n < views.size(); ++n) {
        EXPECT_EQ(all[n].values, again[n].values);
        EXPECT_EQ(all[n].values, moments_of(views[n]).values);
    }
}

TEST(Moments, HandleEmptyFullAndTinyMasks) {
    const ShapeMask empty = draw_shape(64, 64, [](double, double) { return false; });
    const SilhouetteMoments nothing = moments_of(empty.view());
    EXPECT_EQ(nothing.mass_px, 0);
    EXPECT_EQ(nothing.mapping.radius_px, 0);
    EXPECT_THAT(nothing.values, ::testing::Each(0.f));
    EXPECT_THAT(nothing.values, ::testing::SizeIs(moment_values(10)));
    EXPECT_EQ(moments_of({}).mass_px, 0);
    EXPECT_EQ(moments_of(empty.view({30, 30, 20})).mapping.radius_px, 0);

    const ShapeMask full = draw_shape(64, 48, [](double, double) { return true; });
    EXPECT_NEAR(moments_of(full.view()).values[0], 12 / (kPi * 6.25 * 25 / 12), 0.001);  // 4 : 3

    ShapeMask pixel = empty;
    pixel.pixels[20 * 64 + 63] = 255;
    const SilhouetteMoments one = moments_of(pixel.view());
    EXPECT_NEAR(one.mapping.centre_x_px, 63, 1e-5);
    for (float value : one.values) EXPECT_TRUE(std::isfinite(value));
    EXPECT_NEAR(one.values[0], 6 / (2.5 * 2.5 * kPi), 0.01);
}

TEST(Moments, RejectInvalidOptionsAndMappings) {
    EXPECT_THROW(make_moment_calculator(Device::kCpu, {.order = 21}), std::invalid_argument);
    EXPECT_THROW(make_moment_calculator(Device::kCpu, {.order = -1}), std::invalid_argument);
    EXPECT_THROW(make_moment_calculator(Device::kCpu, {.grid = 20}), std::invalid_argument);
    EXPECT_THROW(make_moment_calculator(Device::kCpu, {.disk_per_gyration = std::nanf("")}),
                 std::invalid_argument);
    const ShapeMask mask = draw_figure(64, 64, 32, 32, 20);
    EXPECT_THROW(moments_of(mask.view({32, 32, 0})), std::invalid_argument);
    EXPECT_THROW(moments_of(mask.view({32, INFINITY, 5})), std::invalid_argument);
    EXPECT_THAT(MomentOptions{.order = 21}.check(), ::testing::HasSubstr("0 to 20"));
}

}  // namespace
}  // namespace kinevox::kernels
