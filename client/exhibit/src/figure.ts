// Joints of a figure from the angles of a champion's file. The compared angles are the daemon's geometric angles
// (common/body_pose.h); the drawn angles determine the remaining degrees of freedom.
import type { Angles, Joint, Joints, Vec3 } from "./skeleton";

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

/** Degrees; all 0: standing, arms down. Drawn, not compared. */
export interface Drawn {
  trunk_towards?: number; // direction of the lean: 0 forward, 90 left, 180 back, -90 right
  shoulder_plane_l?: number; // direction in which the arm is raised: 0 forward, 90 sideways, 180 back
  shoulder_plane_r?: number;
  elbow_rotation_l?: number; // about the upper arm; 0 bends forward
  elbow_rotation_r?: number;
  hip_rotation_l?: number; // about the thigh; positive turns the knee outwards
  hip_rotation_r?: number;
  ankle_l?: number; // positive points the toes
  ankle_r?: number;
  neck?: number; // positive looks down
  heading?: number; // 0: along +x
}

// Metres, an adult of 1.75 m.
const PELVIS = 0.1,
  SPINE = 0.42,
  HEAD = 0.24,
  SHOULDERS = 0.18,
  HIPS = 0.09,
  UPPER_ARM = 0.3,
  FOREARM = 0.26,
  HAND = 0.09,
  THIGH = 0.43,
  SHANK = 0.42,
  FOOT = 0.17,
  SOLE = 0.05;

const rad = (degrees: number | undefined) => ((degrees ?? 0) * Math.PI) / 180;

export function figure(angles: Angles, drawn: Drawn = {}): Required<Joints> {
  const heading = rad(drawn.heading);
  const ahead: Vec3 = [Math.cos(heading), Math.sin(heading), 0],
    left: Vec3 = [-Math.sin(heading), Math.cos(heading), 0];
  // The trunk is rigid and rotates about the horizontal axis perpendicular to the direction of the lean.
  const towards = rad(drawn.trunk_towards);
  const axis = cross([0, 0, 1], add(scaled(ahead, Math.cos(towards)), scaled(left, Math.sin(towards))));
  const lean = (v: Vec3) => rotated(v, unit(axis), rad(angles.trunk_lean_geometric));
  const forward = lean(ahead),
    lateral = lean(left),
    up = lean([0, 0, 1]);

  const joints = {} as Record<Joint, Vec3>;
  joints.root = [0, 0, 0];
  joints.sacroiliac = scaled(up, PELVIS);
  joints.skullbase = scaled(up, PELVIS + SPINE);
  joints.head_top = add(joints.skullbase, scaled(rotated(up, lateral, rad(drawn.neck)), HEAD));
  for (const side of ["l", "r"] as const) {
    const sign = side === "l" ? 1 : -1,
      outward = scaled(lateral, sign);
    leg(joints, side, sign, angles, drawn, forward, lateral, up, outward);
    arm(joints, side, sign, angles, drawn, forward, up, outward);
  }
  const lowest = Math.min(
    ...Object.values(joints).map((at) => at[2]),
    joints.ankle_l[2] - SOLE,
    joints.ankle_r[2] - SOLE,
  );
  for (const name of Object.keys(joints) as Joint[]) joints[name] = add(joints[name], [0, 0, -lowest]);
  return joints;
}

function leg(
  joints: Record<Joint, Vec3>,
  side: "l" | "r",
  sign: number,
  angles: Angles,
  drawn: Drawn,
  forward: Vec3,
  lateral: Vec3,
  up: Vec3,
  outward: Vec3,
): void {
  const flexion = rad(angles[`hip_flexion_geometric_${side}`]),
    abduction = rad(angles[`hip_abduction_geometric_${side}`]);
  const inPlane = add(scaled(forward, Math.sin(flexion)), scaled(up, -Math.cos(flexion)));
  const thigh = add(scaled(inPlane, Math.cos(abduction)), scaled(outward, Math.sin(abduction)));
  const hinge = rotated(across(lateral, thigh), thigh, -sign * rad(drawn[`hip_rotation_${side}`]));
  const shank = rotated(thigh, hinge, rad(angles[`knee_flexion_geometric_${side}`]));
  const foot = rotated(shank, hinge, -Math.PI / 2 + rad(drawn[`ankle_${side}`]));
  joints[`hip_${side}`] = scaled(outward, HIPS);
  joints[`knee_${side}`] = add(joints[`hip_${side}`], scaled(thigh, THIGH));
  joints[`ankle_${side}`] = add(joints[`knee_${side}`], scaled(shank, SHANK));
  joints[`toe_${side}`] = add(joints[`ankle_${side}`], scaled(rotated(foot, hinge, 0.29), FOOT)); // down to the sole
}

function arm(
  joints: Record<Joint, Vec3>,
  side: "l" | "r",
  sign: number,
  angles: Angles,
  drawn: Drawn,
  forward: Vec3,
  up: Vec3,
  outward: Vec3,
): void {
  const elevation = rad(angles[`shoulder_elevation_geometric_${side}`]),
    plane = rad(drawn[`shoulder_plane_${side}`]);
  const raised = add(scaled(forward, Math.cos(plane)), scaled(outward, Math.sin(plane)));
  const upper = add(scaled(up, -Math.cos(elevation)), scaled(raised, Math.sin(elevation)));
  const ahead = Math.abs(upper[0] * forward[0] + upper[1] * forward[1] + upper[2] * forward[2]) > 0.98 ? up : forward;
  const bend = rotated(across(ahead, upper), upper, sign * rad(drawn[`elbow_rotation_${side}`]));
  const flexion = rad(angles[`elbow_flexion_geometric_${side}`]);
  const lower = add(scaled(upper, Math.cos(flexion)), scaled(bend, Math.sin(flexion)));
  joints[`shoulder_${side}`] = add(scaled(up, PELVIS + SPINE - 0.04), scaled(outward, SHOULDERS));
  joints[`elbow_${side}`] = add(joints[`shoulder_${side}`], scaled(upper, UPPER_ARM));
  joints[`wrist_${side}`] = add(joints[`elbow_${side}`], scaled(lower, FOREARM));
  joints[`hand_${side}`] = add(joints[`wrist_${side}`], scaled(lower, HAND));
}
