// The visitor's best pose and the champion's, side by side, rotated to the same heading.
import { COLOURS, css } from "./palette";
import { BONES, mirrored, type Joint, type Joints, type Vec3 } from "./skeleton";

const VIEW_DEG = 62; // from the side, a little from the front
const SHOWN_M = 2.0; // height of the canvas

/** Mirrored at the sagittal plane. */
export function reflected(joints: Joints): Joints {
  const out: Joints = {};
  for (const [name, at] of Object.entries(mirrored(joints)) as [Joint, Vec3][]) out[name] = [at[0], -at[1], at[2]];
  return out;
}

/** Heading of the body, radians about z; undefined if the hips are withheld. */
export function headingOf(joints: Joints): number | undefined {
  const left = joints.hip_l,
    right = joints.hip_r;
  if (!left || !right) return undefined;
  return Math.atan2(-(left[0] - right[0]), left[1] - right[1]);
}

export class Duel {
  private readonly context: CanvasRenderingContext2D;
  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d")!;
  }

  /** False while the canvas has no size yet; call it again. */
  draw(visitor: Joints | undefined, champion: Joints, exchanged: boolean): boolean {
    const ratio = window.devicePixelRatio;
    const width = Math.round(this.canvas.clientWidth * ratio),
      height = Math.round(this.canvas.clientHeight * ratio);
    if (width === 0 || height === 0) return false;
    if (this.canvas.width !== width || this.canvas.height !== height)
      ((this.canvas.width = width), (this.canvas.height = height));
    this.context.clearRect(0, 0, width, height);
    if (visitor) this.figure(visitor, 0, width / 2, height);
    else this.placeholder(0, width / 2, height);
    this.figure(exchanged ? reflected(champion) : champion, width / 2, width / 2, height);
    return true;
  }

  private figure(joints: Joints, x0: number, width: number, height: number): void {
    const heading = headingOf(joints) ?? 0,
      view = heading - (VIEW_DEG * Math.PI) / 180;
    const known = Object.values(joints);
    const midpoint = (d: 0 | 1) => (Math.min(...known.map((p) => p[d])) + Math.max(...known.map((p) => p[d]))) / 2;
    const centre = [midpoint(0), midpoint(1)] as const;
    const scale = Math.min(width / 1.22, height / SHOWN_M),
      floor = height * 0.94;
    const project = ([x, y, z]: Vec3): [number, number] => {
      const dx = x - centre[0],
        dy = y - centre[1];
      return [x0 + width / 2 + scale * (-Math.sin(view) * dx + Math.cos(view) * dy), floor - scale * z];
    };
    const depth = ([x, y]: Vec3) => Math.cos(view) * x + Math.sin(view) * y;
    const context = this.context;
    context.lineCap = "round";
    context.lineWidth = Math.max(2, 0.055 * scale);
    const near = (bone: (typeof BONES)[number]) => depth(joints[bone.from]!) + depth(joints[bone.to]!);
    for (const bone of BONES.filter((b) => joints[b.from] && joints[b.to]).sort((a, b) => near(a) - near(b))) {
      context.strokeStyle = css(COLOURS[bone.side]);
      context.beginPath();
      context.moveTo(...project(joints[bone.from]!));
      context.lineTo(...project(joints[bone.to]!));
      context.stroke();
    }
    if (joints.head_top && joints.skullbase) {
      const [hx, hy] = project(joints.head_top),
        [sx, sy] = project(joints.skullbase);
      context.fillStyle = css(COLOURS.middle);
      context.beginPath();
      context.arc((2 * hx + sx) / 3, (2 * hy + sy) / 3, 0.1 * scale, 0, 2 * Math.PI);
      context.fill();
    }
    context.strokeStyle = css(COLOURS.axis);
    context.lineWidth = Math.max(1, 0.008 * scale);
    context.beginPath();
    context.moveTo(x0 + 0.08 * width, floor + 0.03 * scale);
    context.lineTo(x0 + 0.92 * width, floor + 0.03 * scale);
    context.stroke();
  }

  private placeholder(x0: number, width: number, height: number): void {
    this.context.strokeStyle = css(COLOURS.floor);
    this.context.lineWidth = Math.max(1, height / 200);
    this.context.setLineDash([height / 40, height / 30]);
    this.context.beginPath();
    this.context.ellipse(x0 + width / 2, height * 0.52, width * 0.2, height * 0.38, 0, 0, 2 * Math.PI);
    this.context.stroke();
    this.context.setLineDash([]);
  }
}
