#include "server/pose/ray_capsule.h"

#include <algorithm>

#include "kernels/ray_touch.h"

namespace kinevox {
namespace {

kernels::RayBundle bundle_of(const ContourRays& rays) {
    kernels::RayBundle bundle;
    bundle.origin[0] = static_cast<float>(rays.origin_in_world.x);
    bundle.origin[1] = static_cast<float>(rays.origin_in_world.y);
    bundle.origin[2] = static_cast<float>(rays.origin_in_world.z);
    for (int axis = 0; axis < 3; ++axis) {
        bundle.direction[axis] = rays.direction[axis].data();
        bundle.outward[axis] = rays.outward[axis].data();
    }
    bundle.count = static_cast<int>(rays.size());
    return bundle;
}

void copy(std::span<const BodyCapsule> capsules, std::vector<kernels::TaperedCapsule>& out) {
    out.resize(capsules.size());
    for (std::size_t k = 0; k < out.size(); ++k) {
        const BodyCapsule& c = capsules[k];
        out[k] = {{c.a[0], c.a[1], c.a[2]}, {c.b[0], c.b[1], c.b[2]}, c.radius_a, c.radius_b};
    }
}

RayTouch touch_at(const float* from, const float* to, double along, double distance, Vec3 gradient) {
    const Vec3 a{from[0], from[1], from[2]}, b{to[0], to[1], to[2]};
    return {gradient != Vec3{}, distance, along, a + along * (b - a), gradient};
}

}  // namespace

void nearest_capsules(const ContourRays& rays, std::span<const BodyCapsule> capsules,
                      std::vector<float>& distance, std::vector<int>& capsule) {
    distance.resize(rays.size());
    capsule.resize(rays.size());
    thread_local std::vector<kernels::TaperedCapsule> plain;
    copy(capsules, plain);
    kernels::nearest_capsules(bundle_of(rays), plain, distance.data(), capsule.data());
}

double distance_to_ball_m(Vec3 origin, Vec3 direction, const BodyCapsule& capsule) {
    const Vec3 a{capsule.a[0], capsule.a[1], capsule.a[2]}, b{capsule.b[0], capsule.b[1], capsule.b[2]};
    const Vec3 to_centre = 0.5 * (a + b) - origin;
    return norm(to_centre - dot(to_centre, direction) * direction) - 0.5 * norm(b - a) -
           std::max(capsule.radius_a, capsule.radius_b);
}

RayTouch touch_ray(Vec3 origin, Vec3 direction, Vec3 outward, const BodyCapsule& c) {
    const double d[3] = {direction.x, direction.y, direction.z}, n[3] = {outward.x, outward.y, outward.z},
                 o[3] = {origin.x, origin.y, origin.z};
    const kernels::RayTouch touch = kernels::touch_capsule(d, n, o, c.a, c.b, c.radius_a, c.radius_b);
    return touch_at(c.a, c.b, touch.along, touch.distance_m,
                    {touch.gradient[0], touch.gradient[1], touch.gradient[2]});
}

void NearestCapsules::find(const ContourRays& rays, std::span<const BodyCapsule> capsules) {
    copy(capsules, capsules_);
    const kernels::RayBundle bundle = bundle_of(rays);
    const Vec3& o = rays.origin_in_world;
    const double origin[3] = {o.x, o.y, o.z};
    rank_.resize(rays.size());
    capsule_.resize(rays.size());
    for (std::vector<double>* values : {&distance_, &along_, &gradient_[0], &gradient_[1], &gradient_[2]})
        values->resize(rays.size());
    kernels::nearest_capsules(bundle, capsules_, rank_.data(), capsule_.data());
    kernels::touch_capsules(
        bundle, origin, capsules_, capsule_.data(),
        {distance_.data(), along_.data(), {gradient_[0].data(), gradient_[1].data(), gradient_[2].data()}});
}

void NearerCapsules::find(const ContourRays& rays, std::span<const float> ranks,
                          std::span<const BodyCapsule> capsules) {
    copy(capsules, capsules_);
    rank_.assign(ranks.begin(), ranks.end());
    capsule_.resize(rays.size());
    const kernels::RayBundle all = bundle_of(rays);
    kernels::nearer_capsules(all, capsules_, rank_.data(), capsule_.data());
    rays_.clear(), capsule_of_ray_.clear();
    for (auto& values : gathered_) values.clear();
    for (std::size_t i = 0; i < capsule_.size(); ++i) {
        if (capsule_[i] < 0) continue;
        rays_.push_back(static_cast<int>(i));
        capsule_of_ray_.push_back(capsule_[i]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            gathered_[axis].push_back(rays.direction[axis][i]);
            gathered_[3 + axis].push_back(rays.outward[axis][i]);
        }
    }
    for (std::vector<double>* values : {&distance_, &along_, &gradient_[0], &gradient_[1], &gradient_[2]})
        values->resize(rays_.size());
    kernels::RayBundle nearer = all;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        nearer.direction[axis] = gathered_[axis].data();
        nearer.outward[axis] = gathered_[3 + axis].data();
    }
    nearer.count = static_cast<int>(rays_.size());
    const Vec3& o = rays.origin_in_world;
    const double origin[3] = {o.x, o.y, o.z};
    kernels::touch_capsules(
        nearer, origin, capsules_, capsule_of_ray_.data(),
        {distance_.data(), along_.data(), {gradient_[0].data(), gradient_[1].data(), gradient_[2].data()}});
}

std::optional<double> NearerCapsules::distance_m(std::size_t n) const {
    if (gradient_[0][n] == 0 && gradient_[1][n] == 0 && gradient_[2][n] == 0) return std::nullopt;
    return distance_[n];
}

RayTouch NearestCapsules::touch(std::size_t ray) const {
    const kernels::TaperedCapsule& c = capsules_[capsule_[ray]];
    return touch_at(c.a, c.b, along_[ray], distance_[ray],
                    {gradient_[0][ray], gradient_[1][ray], gradient_[2][ray]});
}

}  // namespace kinevox
