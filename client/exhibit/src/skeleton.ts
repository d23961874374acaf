// Joints, bones and angles by name: as in common/skeleton.h and common/joint_angles.h, whose definitions these are.
export type Vec3 = readonly [number, number, number];
export type Side = "left" | "right" | "middle";

export const JOINTS = [
  "root",
  "sacroiliac",
  "skullbase",
  "head_top",
  "shoulder_l",
  "elbow_l",
  "wrist_l",
  "hand_l",
  "hip_l",
  "knee_l",
  "ankle_l",
  "toe_l",
  "shoulder_r",
  "elbow_r",
  "wrist_r",
  "hand_r",
  "hip_r",
  "knee_r",
  "ankle_r",
  "toe_r",
] as const;
export type Joint = (typeof JOINTS)[number];

export const ANGLES = [
  "knee_flexion_l",
  "knee_flexion_r",
  "elbow_flexion_l",
  "elbow_flexion_r",
  "hip_flexion_l",
  "hip_flexion_r",
  "hip_abduction_l",
  "hip_abduction_r",
  "shoulder_elevation_l",
  "shoulder_elevation_r",
  "trunk_lean",
] as const;
export type Angle = (typeof ANGLES)[number];

export const BONES: readonly { from: Joint; to: Joint; side: Side }[] = [
  { from: "root", to: "sacroiliac", side: "middle" },
  { from: "sacroiliac", to: "skullbase", side: "middle" },
  { from: "skullbase", to: "head_top", side: "middle" },
  { from: "shoulder_l", to: "shoulder_r", side: "middle" },
  { from: "hip_l", to: "hip_r", side: "middle" },
  { from: "shoulder_l", to: "elbow_l", side: "left" },
  { from: "elbow_l", to: "wrist_l", side: "left" },
  { from: "wrist_l", to: "hand_l", side: "left" },
  { from: "hip_l", to: "knee_l", side: "left" },
  { from: "knee_l", to: "ankle_l", side: "left" },
  { from: "ankle_l", to: "toe_l", side: "left" },
  { from: "shoulder_r", to: "elbow_r", side: "right" },
  { from: "elbow_r", to: "wrist_r", side: "right" },
  { from: "wrist_r", to: "hand_r", side: "right" },
  { from: "hip_r", to: "knee_r", side: "right" },
  { from: "knee_r", to: "ankle_r", side: "right" },
  { from: "ankle_r", to: "toe_r", side: "right" },
];

/** World, metres, z up. A joint that was withheld is absent. */
export type Joints = Partial<Record<Joint, Vec3>>;
/** Degrees. An angle that was withheld is absent. */
export type Angles = Partial<Record<Angle, number>>;

export const sideOf = (name: string): Side => (name.endsWith("_l") ? "left" : name.endsWith("_r") ? "right" : "middle");

const PAIRS = new Map<string, string>();
for (const name of [...JOINTS, ...ANGLES])
  PAIRS.set(
    name,
    name.replace(/_(l|r)$/, (_, side: string) => (side === "l" ? "_r" : "_l")),
  );

/** Left for right. */
export function mirrored<Values extends Joints | Angles>(values: Values): Values {
  const out: Record<string, unknown> = {};
  for (const [name, value] of Object.entries(values)) out[PAIRS.get(name)!] = value;
  return out as Values;
}
