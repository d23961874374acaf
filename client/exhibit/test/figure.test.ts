// A champion's figure has the angles of its file, as defined in common/body_pose.h.
import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { readChampion } from "../src/champions";
import { headingOf, reflected } from "../src/duel";
import { add, cross, dot, figure, scaled, unit } from "../src/figure";
import { mirrored, type Angle, type Angles, type Joints, type Vec3 } from "../src/skeleton";

const minus = (a: Vec3, b: Vec3) => add(a, scaled(b, -1));
const degrees = (radians: number) => (radians * 180) / Math.PI;
const between = (a: Vec3, b: Vec3) => degrees(Math.atan2(Math.hypot(...cross(a, b)), dot(a, b)));

function anglesOf(j: Required<Joints>): Required<Angles> {
  const hipCentre = scaled(add(j.hip_l, j.hip_r), 0.5),
    shoulders = scaled(add(j.shoulder_l, j.shoulder_r), 0.5);
  const lat = unit(minus(j.hip_l, j.hip_r)),
    spine = minus(j.sacroiliac, hipCentre);
  const up = unit(minus(spine, scaled(lat, dot(spine, lat)))),
    forward = cross(lat, up);
  const out = { trunk_lean_geometric: between(minus(j.skullbase, j.root), [0, 0, 1]) } as Required<Angles>;
  for (const [s, sign] of [
    ["l", 1],
    ["r", -1],
  ] as const) {
    const thigh = minus(j[`knee_${s}`], j[`hip_${s}`]),
      u = unit(thigh);
    out[`knee_flexion_geometric_${s}`] = between(thigh, minus(j[`ankle_${s}`], j[`knee_${s}`]));
    out[`hip_flexion_geometric_${s}`] = degrees(Math.atan2(dot(u, forward), -dot(u, up)));
    out[`hip_abduction_geometric_${s}`] = degrees(Math.asin(sign * dot(u, lat)));
    const upper = minus(j[`elbow_${s}`], j[`shoulder_${s}`]);
    out[`elbow_flexion_geometric_${s}`] = between(upper, minus(j[`wrist_${s}`], j[`elbow_${s}`]));
    out[`shoulder_elevation_geometric_${s}`] = between(upper, minus(hipCentre, shoulders));
  }
  return out;
}

const champion = (id: string) =>
  readChampion(id, JSON.parse(readFileSync(new URL(`../public/champions/${id}.json`, import.meta.url), "utf8")));
const ids = JSON.parse(readFileSync(new URL("../public/champions/index.json", import.meta.url), "utf8")) as string[];

describe("figure", () => {
  for (const id of ids)
    it(`has the angles of ${id}`, () => {
      const { angles_deg, joints } = champion(id);
      const found = anglesOf(joints as Required<Joints>);
      for (const [name, wanted] of Object.entries(angles_deg))
        expect(found[name as Angle], name).toBeCloseTo(wanted, 3);
    });

  it("keeps the angles under heading and limb rotations", () => {
    const angles: Angles = {
      knee_flexion_geometric_l: 40,
      knee_flexion_geometric_r: 70,
      hip_flexion_geometric_l: 30,
      hip_flexion_geometric_r: -10,
      hip_abduction_geometric_l: 20,
      hip_abduction_geometric_r: 5,
      elbow_flexion_geometric_l: 60,
      elbow_flexion_geometric_r: 15,
      shoulder_elevation_geometric_l: 100,
      shoulder_elevation_geometric_r: 30,
      trunk_lean_geometric: 25,
    };
    const found = anglesOf(
      figure(angles, {
        trunk_towards: 70,
        heading: 130,
        shoulder_plane_l: 60,
        elbow_rotation_l: 50,
        hip_rotation_l: 20,
        hip_rotation_r: -15,
        ankle_l: 20,
        neck: 10,
      }),
    );
    for (const [name, wanted] of Object.entries(angles)) expect(found[name as Angle], name).toBeCloseTo(wanted, 3);
  });

  it("stands on the floor with correct sides and heading", () => {
    const joints = figure({}, { heading: 40 });
    expect(Math.min(joints.toe_l[2], joints.ankle_l[2] - 0.05)).toBeCloseTo(0, 2);
    expect(degrees(headingOf(joints)!)).toBeCloseTo(40, 6);
    expect(figure({}).hip_l[1]).toBeGreaterThan(0);
    expect(figure({}).toe_l[0]).toBeGreaterThan(figure({}).ankle_l[0]);
  });

  it("exchanges left and right when reflected", () => {
    const { angles_deg, joints } = champion("javelin");
    const found = anglesOf(reflected(joints) as Required<Joints>);
    for (const [name, wanted] of Object.entries(mirrored(angles_deg)))
      expect(found[name as Angle], name).toBeCloseTo(wanted!, 3);
  });
});
