// The body's joints, bones and geometric angles, from the generated body table.
import { ANGLES, JOINTS, type Angle, type Joint, type Side } from "./body_table";

export { ANGLES, BONES, JOINTS, type Angle, type Joint, type Side } from "./body_table";

export type Vec3 = readonly [number, number, number];

/** World frame, metres, z up. Withheld joints are absent. */
export type Joints = Partial<Record<Joint, Vec3>>;
/** Degrees. Withheld angles are absent. */
export type Angles = Partial<Record<Angle, number>>;

export const sideOf = (name: string): Side => (name.endsWith("_l") ? "left" : name.endsWith("_r") ? "right" : "middle");

const PAIRS = new Map<string, string>();
for (const name of [...JOINTS, ...ANGLES])
  PAIRS.set(
    name,
    name.replace(/_(l|r)$/, (_, side: string) => (side === "l" ? "_r" : "_l")),
  );

/** Exchanges left and right. */
export function mirrored<Values extends Joints | Angles>(values: Values): Values {
  const out: Record<string, unknown> = {};
  for (const [name, value] of Object.entries(values)) out[PAIRS.get(name)!] = value;
  return out as Values;
}
