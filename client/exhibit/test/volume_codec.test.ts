// The decoder against vectors of the C++ codec (make_volume_vectors) and against damaged data.
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { describe, expect, it } from "vitest";
import { VolumeDecoder } from "../src/volume_codec";
import { DamagedVolume } from "../src/volume_sections";

const folder = process.env.KINEVOX_VOLUME_VECTORS;
if (!folder) throw new Error("set KINEVOX_VOLUME_VECTORS to the output folder of make_volume_vectors");
const names = readdirSync(folder).filter((name) => name.endsWith(".kvxv"));
const bytesOf = (name: string) => new Uint8Array(readFileSync(join(folder, name)));

describe("VolumeDecoder", () => {
  const decoder = new VolumeDecoder(); // one for all: reused buffers must not change results

  it("has vectors", () => expect(names.length).toBe(10));

  for (const name of [...names, ...names].reverse())
    it(`decodes ${name} as C++ does`, () => {
      const surface = decoder.decode(bytesOf(name));
      const expected = new DataView(bytesOf(name.replace(".kvxv", ".surface")).buffer);
      expect(surface.count).toBe(expected.getUint32(0, true));
      expect(surface.coloured).toBe(/^person.*coloured/.test(name)); // the others have no colours
      let wrong = 0;
      for (let n = 0; n < surface.count; ++n) {
        for (let d = 0; d < 3; ++d) {
          if (surface.voxels[3 * n + d] !== expected.getInt32(4 + 16 * n + 4 * d, true)) ++wrong;
          if (surface.coloured && surface.colours[3 * n + d] !== expected.getUint8(16 + 16 * n + d)) ++wrong;
        }
      }
      expect(wrong).toBe(0);
    });

  it("returns origin and voxel size", () => {
    const surface = decoder.decode(bytesOf("blocks.kvxv"));
    expect(surface.originInWorld).toEqual([-0.5, 2, 0]);
    expect(surface.voxel_m).toBeCloseTo(0.02, 12);
  });

  it("throws only DamagedVolume for damaged data", () => {
    let seed = 1;
    const random = (n: number) => (seed = (seed * 48271) % 2147483647) % n;
    let damaged = 0;
    for (const name of ["person_50mm_coloured.kvxv", "person_50mm.kvxv", "blocks.kvxv"]) {
      const good = bytesOf(name);
      for (let n = 0; n < 400; ++n) {
        const bad = n % 4 === 0 ? good.slice(0, random(good.length)) : good.slice();
        for (let m = 0; m <= n % 3; ++m)
          if (bad.length > 0) bad[random(n % 2 ? Math.min(120, bad.length) : bad.length)] = random(256);
        try {
          decoder.decode(bad);
        } catch (error) {
          expect(error).toBeInstanceOf(DamagedVolume);
          ++damaged;
        }
      }
    }
    expect(damaged).toBeGreaterThan(600);
    expect(decoder.decode(bytesOf("person_50mm.kvxv")).count).toBeGreaterThan(100); // still works
  });
});
