// A figure from angles: what a champion's file says, as joints to draw. The angles that are compared mean what the
// daemon's mean (common/joint_angles.h); those that are only drawn settle the rest.
import type { Angles, Joint, Joints, Vec3 } from "./skeleton";
import { across, add, cross, scaled, turned, unit } from "./vector";

/** Degrees; all 0: standing, arms hanging. Only drawn, never compared. */
export interface Drawn {
  trunk_towards?: number; // where the trunk leans to: 0 forward, 90 left, 180 back, -90 right
  shoulder_plane_l?: number; // where the arm is raised to: 0 forward, 90 sideways, 180 back
  shoulder_plane_r?: number;
  elbow_turn_l?: number; // about the upper arm; 0 bends forward
  elbow_turn_r?: number;
  hip_turn_l?: number; // about the thigh; positive turns the knee outwards
  hip_turn_r?: number;
  ankle_l?: number; // positive points the toes
  ankle_r?: number;
  neck?: number; // positive looks down
  heading?: number; // 0 looks along +x
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
  // The trunk leans as one: about the level axis that is across where it leans to.
  const towards = rad(drawn.trunk_towards);
  const axis = cross([0, 0, 1], add(scaled(ahead, Math.cos(towards)), scaled(left, Math.sin(towards))));
  const lean = (v: Vec3) => turned(v, unit(axis), rad(angles.trunk_lean));
  const forward = lean(ahead),
    lateral = lean(left),
    up = lean([0, 0, 1]);

  const joints = {} as Record<Joint, Vec3>;
  joints.root = [0, 0, 0];
  joints.sacroiliac = scaled(up, PELVIS);
  joints.skullbase = scaled(up, PELVIS + SPINE);
  joints.head_top = add(joints.skullbase, scaled(turned(up, lateral, rad(drawn.neck)), HEAD));
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
  const flexion = rad(angles[`hip_flexion_${side}`]),
    abduction = rad(angles[`hip_abduction_${side}`]);
  const inPlane = add(scaled(forward, Math.sin(flexion)), scaled(up, -Math.cos(flexion)));
  const thigh = add(scaled(inPlane, Math.cos(abduction)), scaled(outward, Math.sin(abduction)));
  const hinge = turned(across(lateral, thigh), thigh, -sign * rad(drawn[`hip_turn_${side}`]));
  const shank = turned(thigh, hinge, rad(angles[`knee_flexion_${side}`]));
  const foot = turned(shank, hinge, -Math.PI / 2 + rad(drawn[`ankle_${side}`]));
  joints[`hip_${side}`] = scaled(outward, HIPS);
  joints[`knee_${side}`] = add(joints[`hip_${side}`], scaled(thigh, THIGH));
  joints[`ankle_${side}`] = add(joints[`knee_${side}`], scaled(shank, SHANK));
  joints[`toe_${side}`] = add(joints[`ankle_${side}`], scaled(turned(foot, hinge, 0.29), FOOT)); // down to the sole
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
  const elevation = rad(angles[`shoulder_elevation_${side}`]),
    plane = rad(drawn[`shoulder_plane_${side}`]);
  const aside = add(scaled(forward, Math.cos(plane)), scaled(outward, Math.sin(plane)));
  const upper = add(scaled(up, -Math.cos(elevation)), scaled(aside, Math.sin(elevation)));
  const ahead = Math.abs(upper[0] * forward[0] + upper[1] * forward[1] + upper[2] * forward[2]) > 0.98 ? up : forward;
  const bend = turned(across(ahead, upper), upper, sign * rad(drawn[`elbow_turn_${side}`]));
  const flexion = rad(angles[`elbow_flexion_${side}`]);
  const lower = add(scaled(upper, Math.cos(flexion)), scaled(bend, Math.sin(flexion)));
  joints[`shoulder_${side}`] = add(scaled(up, PELVIS + SPINE - 0.04), scaled(outward, SHOULDERS));
  joints[`elbow_${side}`] = add(joints[`shoulder_${side}`], scaled(upper, UPPER_ARM));
  joints[`wrist_${side}`] = add(joints[`elbow_${side}`], scaled(lower, FOREARM));
  joints[`hand_${side}`] = add(joints[`wrist_${side}`], scaled(lower, HAND));
}
