// The body's names, by common/make-body-table from common/body_table.toml; do not edit.
export type Side = "left" | "right" | "middle";

// In the order of joints.csv.
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

// Angles from joint positions, in the order of angles.csv.
export const ANGLES = [
  "knee_flexion_geometric_l",
  "knee_flexion_geometric_r",
  "elbow_flexion_geometric_l",
  "elbow_flexion_geometric_r",
  "hip_flexion_geometric_l",
  "hip_flexion_geometric_r",
  "hip_abduction_geometric_l",
  "hip_abduction_geometric_r",
  "shoulder_elevation_geometric_l",
  "shoulder_elevation_geometric_r",
  "trunk_lean_geometric",
] as const;
export type Angle = (typeof ANGLES)[number];

// By the name without _geometric and side.
export const ANGLE_LABELS = {
  knee_flexion: "Knee flexion",
  elbow_flexion: "Elbow flexion",
  hip_flexion: "Hip flexion",
  hip_abduction: "Hip abduction",
  shoulder_elevation: "Shoulder elevation",
  trunk_lean: "Trunk lean",
} as const;

// Lines between joints, for drawing.
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
