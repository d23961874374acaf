// Decodes an encoded volume (docs/volume_format.md). Buffers are reused between messages, so that continuous decoding
// creates almost no garbage.
import { DamagedVolume, readSections } from "./volume_sections";

const MAX_BOX_VOXELS = 1 << 27; // of the bounding box of the bricks
export const RIM = 3; // empty voxels around the box, for neighbour tests

/** The surface of one volume; its arrays belong to the decoder and are valid until the next decode(). */
export interface Surface {
  originInWorld: [number, number, number]; // of voxel (0, 0, 0), m
  voxel_m: number;
  count: number; // surface voxels
  voxels: Int32Array; // i, j, k of each
  colours: Uint8Array; // r, g, b of each
  coloured: boolean;
  // Occupancy, one byte per voxel, x fastest, with a rim of RIM empty voxels.
  box: { first: [number, number, number]; size: [number, number, number]; inside: Uint8Array };
}

/** Offsets of the octants of a brick, the cells of an octant and the voxels of a cell: z y x, one bit each. */
const DX = [0, 1, 0, 1, 0, 1, 0, 1];
const DY = [0, 0, 1, 1, 0, 0, 1, 1];
const DZ = [0, 0, 0, 0, 1, 1, 1, 1];

// Neighbours that a colour is predicted from, in this order, in the padded brick of 10 x 10 x 10.
const STEPS = [
  [-1, 0, 0],
  [0, -1, 0],
  [0, 0, -1],
  [1, -1, 0],
  [-1, -1, 0],
  [-1, 0, -1],
  [1, 0, -1],
  [0, -1, -1],
  [0, 1, -1],
].map(([x, y, z]) => z! * 100 + y! * 10 + x!);

const LEVELS = Uint8Array.from({ length: 64 }, (_, q) => Math.floor((q * 255 + 31) / 63));

function grown<T extends Uint8Array | Int32Array | Int16Array>(array: T, length: number, make: (n: number) => T): T {
  return array.length >= length ? array : make(Math.ceil(length * 1.5));
}

export class VolumeDecoder {
  private inside = new Uint8Array(0);
  private bricks = new Int32Array(0); // x, y, z of each
  private voxels = new Int32Array(0);
  private colours = new Uint8Array(0);
  private coded = new Int16Array(0); // Y, Co, Cg of each colour
  private readonly number = new Int32Array(1000); // colour of a voxel of the padded brick, from 1; 0: none

  /** Throws DamagedVolume for invalid data. */
  decode(bytes: Uint8Array): Surface {
    const { originInWorld, voxel_m, size, count, colours, coloured, sections } = readSections(bytes);
    this.readBrickIndices(sections[0]!, count, size);
    const box = this.makeBox(count);
    this.fill(box, sections[1]!, sections[2]!, sections[3]!, count);
    const found = this.findSurface(box, count);
    if (coloured) {
      if (found !== colours) throw new DamagedVolume("the number of colours differs from the number of surface voxels");
      this.readColours(sections[4]!, sections[5]!, sections[6]!, count, found);
    }
    return { originInWorld, voxel_m, count: found, voxels: this.voxels, colours: this.colours, coloured, box };
  }

  private readBrickIndices(deltas: Uint8Array, count: number, [bx, by, bz]: [number, number, number]): void {
    this.bricks = grown(this.bricks, 3 * count, (n) => new Int32Array(n));
    let at = 0,
      index = -1;
    const end = bx * by * bz;
    for (let n = 0; n < count; ++n) {
      let delta = 0,
        scale = 1,
        byte: number;
      do {
        if (at >= deltas.length || scale > 2 ** 42) throw new DamagedVolume("the brick index deltas are damaged");
        byte = deltas[at++]!;
        delta += (byte & 0x7f) * scale; // beyond the 32 bits of <<
        scale *= 128;
      } while (byte & 0x80);
      index += delta + 1;
      if (index >= end) throw new DamagedVolume("a brick is outside the grid");
      this.bricks[3 * n] = index % bx;
      this.bricks[3 * n + 1] = Math.floor(index / bx) % by;
      this.bricks[3 * n + 2] = Math.floor(index / (bx * by));
    }
    if (at !== deltas.length) throw new DamagedVolume("the number of brick index deltas differs from the number of bricks");
  }

  private makeBox(count: number): Surface["box"] {
    const low = [Infinity, Infinity, Infinity],
      high = [-Infinity, -Infinity, -Infinity];
    for (let n = 0; n < 3 * count; ++n) {
      low[n % 3] = Math.min(low[n % 3]!, this.bricks[n]!);
      high[n % 3] = Math.max(high[n % 3]!, this.bricks[n]!);
    }
    const extent = (d: number) => (count ? 8 * (high[d]! - low[d]! + 1) : 0) + 2 * RIM;
    const first = (d: number) => (count ? 8 * low[d]! : 0) - RIM;
    const size: [number, number, number] = [extent(0), extent(1), extent(2)];
    const voxels = size[0] * size[1] * size[2];
    if (voxels > MAX_BOX_VOXELS) throw new DamagedVolume(`its bricks span ${voxels} voxels, too many to draw`);
    if (this.inside.length >= voxels) this.inside.fill(0, 0, voxels);
    else this.inside = new Uint8Array(Math.ceil(1.5 * voxels));
    return { first: [first(0), first(1), first(2)], size, inside: this.inside };
  }

  private fill(box: Surface["box"], bricks: Uint8Array, octants: Uint8Array, cells: Uint8Array, count: number): void {
    const problem = () => new DamagedVolume("an octree mask is inconsistent");
    const short = () => new DamagedVolume("the length of the shape sections does not match the shape");
    const [sx, sy] = box.size,
      inside = box.inside;
    let octant = 0,
      cell = 0;
    const block = (at: number, edge: number) => {
      for (let z = 0; z < edge; ++z)
        for (let y = 0; y < edge; ++y) inside.fill(1, at + (z * sy + y) * sx, at + (z * sy + y) * sx + edge);
    };
    const step = (at: number, n: number, edge: number) => at + ((DZ[n]! * sy + DY[n]!) * sx + DX[n]!) * edge;
    for (let b = 0; b < count; ++b) {
      const some = bricks[2 * b]!,
        full = bricks[2 * b + 1]!;
      if (some === 0 || full & ~some) throw problem();
      const corner =
        ((8 * this.bricks[3 * b + 2]! - box.first[2]) * sy + 8 * this.bricks[3 * b + 1]! - box.first[1]) * sx +
        8 * this.bricks[3 * b]! -
        box.first[0];
      for (let o = 0; o < 8; ++o) {
        if (!((some >> o) & 1)) continue;
        const inOctant = step(corner, o, 4);
        if ((full >> o) & 1) {
          block(inOctant, 4);
          continue;
        }
        if (octant + 2 > octants.length) throw short();
        const someCells = octants[octant++]!,
          fullCells = octants[octant++]!;
        if (someCells === 0 || fullCells & ~someCells || fullCells === 0xff) throw problem();
        for (let c = 0; c < 8; ++c) {
          if (!((someCells >> c) & 1)) continue;
          const inCell = step(inOctant, c, 2);
          if ((fullCells >> c) & 1) {
            block(inCell, 2);
            continue;
          }
          if (cell >= cells.length) throw short();
          const mask = cells[cell++]!;
          if (mask === 0 || mask === 0xff) throw problem();
          for (let v = 0; v < 8; ++v) if ((mask >> v) & 1) inside[step(inCell, v, 1)] = 1;
        }
      }
    }
    if (octant !== octants.length || cell !== cells.length) throw short();
  }

  private findSurface(box: Surface["box"], count: number): number {
    const [sx, sy] = box.size,
      slice = sx * sy,
      inside = box.inside;
    let found = 0;
    for (let b = 0; b < count; ++b) {
      this.voxels = keep(this.voxels, 3 * (found + 512), 3 * found);
      const i = 8 * this.bricks[3 * b]!,
        j = 8 * this.bricks[3 * b + 1]!,
        k = 8 * this.bricks[3 * b + 2]!;
      for (let z = 0; z < 8; ++z)
        for (let y = 0; y < 8; ++y) {
          let at = ((k + z - box.first[2]) * sy + j + y - box.first[1]) * sx + i - box.first[0];
          for (let x = 0; x < 8; ++x, ++at) {
            if (!inside[at]) continue;
            if (
              inside[at - 1]! &
              inside[at + 1]! &
              inside[at - sx]! &
              inside[at + sx]! &
              inside[at - slice]! &
              inside[at + slice]!
            )
              continue;
            this.voxels[3 * found] = i + x;
            this.voxels[3 * found + 1] = j + y;
            this.voxels[3 * found + 2] = k + z;
            ++found;
          }
        }
    }
    return found;
  }

  private readColours(ys: Uint8Array, cos: Uint8Array, cgs: Uint8Array, count: number, total: number): void {
    this.coded = grown(this.coded, 3 * (total + 1), (n) => new Int16Array(n));
    this.colours = grown(this.colours, 3 * total, (n) => new Uint8Array(n));
    const { coded, colours, number } = this;
    let n = 0;
    let lastY = 0,
      lastCo = 0,
      lastCg = 0;
    for (let b = 0; b < count; ++b) {
      number.fill(0);
      const i = 8 * this.bricks[3 * b]! - 1,
        j = 8 * this.bricks[3 * b + 1]! - 1,
        k = 8 * this.bricks[3 * b + 2]! - 1;
      for (; n < total; ++n) {
        const x = this.voxels[3 * n]! - i,
          y = this.voxels[3 * n + 1]! - j,
          z = this.voxels[3 * n + 2]! - k;
        if (x < 1 || x > 8 || y < 1 || y > 8 || z < 1 || z > 8) break; // belongs to the next brick
        const here = z * 100 + y * 10 + x;
        let first = -1,
          second = -1;
        for (const step of STEPS) {
          const known = number[here + step]!;
          if (known === 0) continue;
          if (first < 0) first = known - 1;
          else {
            second = known - 1;
            break;
          }
        }
        if (second >= 0) {
          lastY = (coded[3 * first]! + coded[3 * second]!) >> 1;
          lastCo = (coded[3 * first + 1]! + coded[3 * second + 1]!) >> 1;
          lastCg = (coded[3 * first + 2]! + coded[3 * second + 2]!) >> 1;
        } else if (first >= 0) {
          ((lastY = coded[3 * first]!), (lastCo = coded[3 * first + 1]!), (lastCg = coded[3 * first + 2]!));
        }
        lastY = ((lastY + ys[n]!) << 24) >> 24; // modulo 256, signed
        lastCo = ((lastCo + cos[n]!) << 24) >> 24;
        lastCg = ((lastCg + cgs[n]!) << 24) >> 24;
        ((coded[3 * n] = lastY), (coded[3 * n + 1] = lastCo), (coded[3 * n + 2] = lastCg));
        number[here] = n + 1;
        const t = lastY - (lastCg >> 1),
          green = lastCg + t,
          blue = t - (lastCo >> 1),
          red = blue + lastCo;
        if ((red | green | blue) & ~63) throw new DamagedVolume("a colour is out of range");
        ((colours[3 * n] = LEVELS[red]!), (colours[3 * n + 1] = LEVELS[green]!), (colours[3 * n + 2] = LEVELS[blue]!));
      }
    }
  }
}

function keep(array: Int32Array<ArrayBuffer>, length: number, used: number): Int32Array<ArrayBuffer> {
  if (array.length >= length) return array;
  const larger = new Int32Array(Math.ceil(1.5 * length));
  larger.set(array.subarray(0, used));
  return larger;
}
