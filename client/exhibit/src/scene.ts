// The 3-D scene: floor, volume, skeleton, and a champion's figure in attract mode.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DirectionalLight,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  PerspectiveCamera,
  Scene as ThreeScene,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { COLOURS } from "./palette";
import type { Joints, Vec3 } from "./skeleton";
import { StickFigure } from "./stick_figure";
import type { Surface } from "./volume_codec";
import { VolumePoints } from "./volume_points";

const FIELD_DEG = 38,
  DISTANCE_M = 4.6,
  EYE_M = 1.5,
  LOOK_M = 0.95;
const FLOOR_M = 6,
  GRID_M = 0.5;
const UNTOUCHED_MS = 25_000; // then the view rotates automatically
const MAX_PIXELS = 3840 * 2160;

/** Counts resize events: reading the size itself forces a layout each time. */
export const windowSize = { changes: 0 };
addEventListener("resize", () => (windowSize.changes += 1));

export class Scene {
  readonly renderer: WebGLRenderer;
  private readonly scene = new ThreeScene();
  private readonly camera = new PerspectiveCamera(FIELD_DEG, 1, 0.1, 60);
  private readonly controls: OrbitControls;
  private readonly volume = new VolumePoints();
  private readonly others: VolumePoints[] = []; // outlines
  private pixelsPerMetre = 1;
  private readonly body = new StickFigure(1);
  private readonly champion = new StickFigure(2, 1.5);
  private readonly target = new Vector3(0, 0, LOOK_M);
  private readonly step = new Vector3();
  private touchedAt = -Infinity;
  private drawnAt = 0;

  constructor(canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.setClearColor(COLOURS.background);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(DISTANCE_M * 0.82, -DISTANCE_M * 0.57, EYE_M);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.copy(this.target);
    this.controls.enableDamping = true;
    this.controls.enablePan = false;
    this.controls.minDistance = 1.5;
    this.controls.maxDistance = 9;
    this.controls.minPolarAngle = 0.15;
    this.controls.maxPolarAngle = Math.PI / 2 - 0.02; // not from under the floor
    this.controls.addEventListener("start", () => (this.touchedAt = performance.now()));
    this.scene.add(floor(), this.volume.object, this.body.object, this.champion.object);
    this.scene.add(new HemisphereLight(0xffffff, 0x8890a0, 2.3));
    const sun = new DirectionalLight(0xffffff, 1.5);
    sun.position.set(2, -3, 5);
    this.scene.add(sun);
  }

  resize(width: number, height: number): void {
    const ratio = Math.min(window.devicePixelRatio, Math.sqrt(MAX_PIXELS / Math.max(1, width * height)));
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // A narrow window still shows a person with outstretched arms.
    const min = 2.3 / DISTANCE_M / 2,
      wide = Math.tan((FIELD_DEG * Math.PI) / 360) * this.camera.aspect;
    this.camera.fov = (360 / Math.PI) * Math.atan(Math.tan((FIELD_DEG * Math.PI) / 360) * Math.max(1, min / wide));
    this.camera.updateProjectionMatrix();
    this.pixelsPerMetre = (ratio * height) / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
    for (const volume of [this.volume, ...this.others]) volume.pixelsPerMetre = this.pixelsPerMetre;
  }

  /** Sets the person's position in the window, as fractions of its size. */
  aim(x: number, y: number): void {
    const width = this.camera.aspect; // setViewOffset sets it to the ratio of its first two arguments
    this.camera.setViewOffset(width, 1, (0.5 - x) * width, 0.5 - y, width, 1);
  }

  showVolume(surface: Surface | undefined): void {
    if (surface) this.volume.show(surface);
    else this.volume.hide();
  }

  /** The outline of a person who is not followed, numbered from 0. */
  showOther(number: number, surface: Surface): void {
    let other = this.others[number];
    if (!other) {
      this.others[number] = other = new VolumePoints("outline");
      other.pixelsPerMetre = this.pixelsPerMetre;
      this.scene.add(other.object);
    }
    other.show(surface);
  }

  hideOthersFrom(number: number): void {
    for (const other of this.others.slice(number)) other.hide();
  }

  showBody(joints: Joints | undefined): void {
    if (joints) this.body.show(joints);
    else this.body.hide();
  }

  showChampion(joints: Joints | undefined): void {
    if (joints) this.champion.show(joints);
    else this.champion.hide();
  }

  /** `centre`: of the person; undefined without one. */
  draw(now_ms: number, centre: Vec3 | undefined, attract: boolean): void {
    const elapsed_s = Math.min(0.25, Math.max(0, (now_ms - this.drawnAt) / 1000));
    this.drawnAt = now_ms;
    this.target.set(centre?.[0] ?? 0, centre?.[1] ?? 0, LOOK_M);
    // Camera and target follow slowly together: the person moves in the image and the image does not shake.
    this.step
      .copy(this.target)
      .sub(this.controls.target)
      .multiplyScalar(1 - Math.exp(-3 * elapsed_s));
    this.controls.target.add(this.step);
    this.camera.position.add(this.step);
    const untouched = performance.now() - this.touchedAt > UNTOUCHED_MS;
    this.controls.autoRotate = untouched;
    this.controls.autoRotateSpeed = attract ? 1.6 : 0.5;
    this.controls.update(elapsed_s);
    this.renderer.render(this.scene, this.camera);
  }
}

/** Grid lines every 0.5 m that fade with the distance. */
function floor(): LineSegments {
  const positions: number[] = [],
    colours: number[] = [];
  const background = new Color(COLOURS.background),
    line = new Color(),
    shade = new Color();
  const add = (x: number, y: number) => {
    positions.push(x, y, 0);
    shade.copy(background).lerp(line, Math.max(0, 1 - Math.hypot(x, y) / FLOOR_M) ** 1.3);
    colours.push(shade.r, shade.g, shade.b);
  };
  for (let n = -FLOOR_M / GRID_M; n <= FLOOR_M / GRID_M; ++n)
    for (let m = -FLOOR_M / GRID_M; m < FLOOR_M / GRID_M; ++m) {
      line.set(n === 0 ? COLOURS.axis : COLOURS.floor);
      (add(n * GRID_M, m * GRID_M), add(n * GRID_M, (m + 1) * GRID_M));
      (add(m * GRID_M, n * GRID_M), add((m + 1) * GRID_M, n * GRID_M));
    }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.setAttribute("color", new BufferAttribute(new Float32Array(colours), 3));
  return new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true }));
}
