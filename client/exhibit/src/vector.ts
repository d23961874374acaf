import type { Vec3 } from "./skeleton";

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const scaled = (a: Vec3, k: number): Vec3 => [a[0] * k, a[1] * k, a[2] * k];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const unit = (a: Vec3): Vec3 => scaled(a, 1 / Math.max(1e-12, Math.hypot(...a)));
/** The component of `a` perpendicular to the unit vector `b`, normalised. */
export const across = (a: Vec3, b: Vec3): Vec3 => unit(add(a, scaled(b, -dot(a, b))));
export const mix = (a: Vec3, b: Vec3, fraction: number): Vec3 =>
  add(scaled(a, 1 - fraction), scaled(b, fraction));
/** `a` rotated about the unit vector `axis`, right-handed. */
export function rotated(a: Vec3, axis: Vec3, radians: number): Vec3 {
  const c = Math.cos(radians),
    s = Math.sin(radians);
  return add(add(scaled(a, c), scaled(cross(axis, a), s)), scaled(axis, dot(axis, a) * (1 - c)));
}
