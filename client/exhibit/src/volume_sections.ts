// Header and unpacked sections of an encoded volume (docs/volume_format.md).
import { decompress } from "fzstd";

const HEADER_BYTES = 56;
const MAX_BRICKS = 1 << 20;
const MAX_COLOURS = 1 << 24;

export class DamagedVolume extends Error {}

export interface Sections {
  originInWorld: [number, number, number]; // of voxel (0, 0, 0), m
  voxel_m: number;
  size: [number, number, number]; // bricks
  count: number; // encoded bricks
  colours: number;
  coloured: boolean;
  sections: Uint8Array[];
}

/** Checks all sizes before unpacking. */
export function readSections(bytes: Uint8Array): Sections {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.length < HEADER_BYTES) throw new DamagedVolume(`${bytes.length} bytes are too short for a header`);
  if (view.getUint32(0, false) !== 0x4b565856) throw new DamagedVolume("does not begin with KVXV");
  if (bytes[4] !== 1) throw new DamagedVolume(`unknown version ${bytes[4]}`);
  const flags = bytes[5]!;
  const originInWorld: [number, number, number] = [
    view.getFloat64(8, true),
    view.getFloat64(16, true),
    view.getFloat64(24, true),
  ];
  const voxel_m = view.getFloat64(32, true);
  const size: [number, number, number] = [view.getUint16(40, true), view.getUint16(42, true), view.getUint16(44, true)];
  const count = view.getUint32(48, true);
  const colours = view.getUint32(52, true);
  const sane =
    flags <= 1 &&
    originInWorld.every(Number.isFinite) &&
    Number.isFinite(voxel_m) &&
    voxel_m > 0 &&
    view.getUint16(6, true) === 0 &&
    view.getUint16(46, true) === 0;
  if (!sane) throw new DamagedVolume("invalid header");
  if (count > MAX_BRICKS || colours > MAX_COLOURS || (flags === 0 && colours > 0) || size.some((n) => n > 32767))
    throw new DamagedVolume(`${count} bricks and ${colours} colours exceed the limits`);
  const sections = unpackSections(bytes, view, flags ? 7 : 4, count, colours);
  return { originInWorld, voxel_m, size, count, colours, coloured: flags === 1, sections };
}

function unpackSections(
  bytes: Uint8Array,
  view: DataView,
  number: number,
  count: number,
  colours: number,
): Uint8Array[] {
  let start = HEADER_BYTES + 8 * number;
  if (bytes.length < start) throw new DamagedVolume("ends within the header");
  const raw: number[] = [],
    stored: number[] = [];
  for (let n = 0; n < number; ++n) {
    raw.push(view.getUint32(HEADER_BYTES + 8 * n, true));
    stored.push(view.getUint32(HEADER_BYTES + 8 * n + 4, true));
  }
  if (start + stored.reduce((a, b) => a + b, 0) !== bytes.length)
    throw new DamagedVolume("the length differs from the header");
  const fits =
    raw[0]! >= count &&
    raw[0]! <= 7 * count &&
    raw[1] === 2 * count &&
    raw[2]! % 2 === 0 &&
    raw[2]! <= 16 * count &&
    raw[3]! <= 4 * raw[2]! &&
    raw.slice(4).every((n) => n === colours);
  if (!fits) throw new DamagedVolume("the section sizes do not match the number of bricks or colours");
  return raw.map((length, n) => {
    const piece = bytes.subarray(start, (start += stored[n]!));
    if (stored[n] === length) return piece;
    if (frameContentSize(piece) !== length) throw new DamagedVolume(`the size of section ${n} differs from the header`);
    let unpacked: Uint8Array;
    try {
      unpacked = decompress(piece, new Uint8Array(length));
    } catch {
      throw new DamagedVolume(`section ${n} cannot be unpacked`);
    }
    if (unpacked.length !== length) throw new DamagedVolume(`the size of section ${n} differs from the header`);
    return unpacked;
  });
}

/** Content size stated by a zstd frame (RFC 8878, 3.1.1.1); -1 if it states none. */
function frameContentSize(frame: Uint8Array): number {
  if (frame.length < 6 || frame[0] !== 0x28 || frame[1] !== 0xb5 || frame[2] !== 0x2f || frame[3] !== 0xfd) return -1;
  const descriptor = frame[4]!,
    single = (descriptor >> 5) & 1,
    kind = descriptor >> 6;
  const at = 5 + (single ? 0 : 1) + [0, 1, 2, 4][descriptor & 3]!;
  const bytes = kind === 0 ? single : 1 << kind;
  if (bytes === 0 || frame.length < at + bytes) return -1;
  let size = 0;
  for (let n = Math.min(bytes, 6) - 1; n >= 0; --n) size = size * 256 + frame[at + n]!;
  return bytes === 2 ? size + 256 : size;
}
