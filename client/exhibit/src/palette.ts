// As in all of Kinevox's figures: left blue, right orange.
export const COLOURS = {
  background: 0x0d0f14,
  floor: 0x39414f,
  axis: 0x5b667a,
  left: 0x46a0ff,
  right: 0xff9628,
  middle: 0xf0f0f0,
  otherInner: 0x1a202a, // of people who are not followed
  otherRim: 0xa3b0c6,
} as const;

export const css = (colour: number) => `#${colour.toString(16).padStart(6, "0")}`;
