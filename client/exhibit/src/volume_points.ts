// The volume for three.js: one square per surface voxel at its projected size, lit from the upper left. Buffers are
// reused and only grow.
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  LinearSRGBColorSpace,
  Points,
  ShaderMaterial,
  Sphere,
  Vector3,
} from "three";
import { COLOURS } from "./palette";
import type { Surface } from "./volume_codec";

const GREY = 190;
const NORMAL_RADIUS = 2; // voxels; at most the box's rim
const NEIGHBOURS: readonly (readonly [number, number, number])[] = (() => {
  const around: [number, number, number][] = [];
  for (let z = -NORMAL_RADIUS; z <= NORMAL_RADIUS; ++z)
    for (let y = -NORMAL_RADIUS; y <= NORMAL_RADIUS; ++y)
      for (let x = -NORMAL_RADIUS; x <= NORMAL_RADIUS; ++x) {
        const squared = x * x + y * y + z * z;
        if (squared > 0 && squared <= NORMAL_RADIUS * NORMAL_RADIUS + 1 && (x + y + z) % 2 !== 0) around.push([x, y, z]);
      }
  return around;
})();

const VERTEX = `
attribute vec3 colour;
uniform float pixels_per_metre, voxel_m;
#ifdef OUTLINE
uniform vec3 inner, rim;
#endif
varying vec3 shade;
void main() {
  vec4 eye = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * eye;
  // The projection of a cube is wider than its edge.
  gl_PointSize = max(1.0, 1.4 * voxel_m * pixels_per_metre / max(0.05, -eye.z));
  vec3 outwards = normalize(mat3(viewMatrix) * normal);
#ifdef OUTLINE
  float edge = 1.0 - abs(dot(outwards, normalize(eye.xyz)));
  shade = mix(inner, rim, smoothstep(0.35, 0.9, edge));
#else
  float facing = dot(outwards, normalize(vec3(-0.35, 0.45, 0.82)));
  shade = colour * mix(0.42, 1.15, 0.5 + 0.5 * facing);
#endif
}`;
const FRAGMENT = `
varying vec3 shade;
void main() { gl_FragColor = vec4(shade, 1.0); }`;

/** As on the screen: the fragments are not converted. */
const shown = (colour: number) => new Color().setHex(colour, LinearSRGBColorSpace);

export class VolumePoints {
  readonly object: Points<BufferGeometry, ShaderMaterial>;
  private capacity = 0;
  private steps = new Int32Array(NEIGHBOURS.length);

  /** `outline`: dim, bright at the rim, without the colours of the clothes. */
  constructor(kind: "coloured" | "outline" = "coloured") {
    const material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      defines: kind === "outline" ? { OUTLINE: "" } : {},
      uniforms: {
        pixels_per_metre: { value: 1 },
        voxel_m: { value: 0.01 },
        inner: { value: shown(COLOURS.otherInner) },
        rim: { value: shown(COLOURS.otherRim) },
      },
    });
    this.object = new Points(new BufferGeometry(), material);
    this.object.frustumCulled = false; // always in view
    this.object.visible = false;
  }

  set pixelsPerMetre(pixels: number) {
    this.object.material.uniforms.pixels_per_metre!.value = pixels;
  }

  hide(): void {
    this.object.visible = false;
  }

  show(surface: Surface): void {
    if (surface.count > this.capacity) this.grow(surface.count);
    const geometry = this.object.geometry;
    const position = geometry.getAttribute("position") as BufferAttribute;
    const colour = geometry.getAttribute("colour") as BufferAttribute;
    const normal = geometry.getAttribute("normal") as BufferAttribute;
    const {
      voxels,
      count,
      voxel_m,
      originInWorld: [ox, oy, oz],
    } = surface;
    const at = position.array as Float32Array;
    for (let n = 0; n < count; ++n) {
      at[3 * n] = ox + voxel_m * (voxels[3 * n]! + 0.5);
      at[3 * n + 1] = oy + voxel_m * (voxels[3 * n + 1]! + 0.5);
      at[3 * n + 2] = oz + voxel_m * (voxels[3 * n + 2]! + 0.5);
    }
    if (surface.coloured) (colour.array as Uint8Array).set(surface.colours.subarray(0, 3 * count));
    else (colour.array as Uint8Array).fill(GREY, 0, 3 * count);
    this.normals(surface, normal.array as Int8Array);
    for (const attribute of [position, colour, normal]) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 3 * count);
      attribute.needsUpdate = true;
    }
    geometry.setDrawRange(0, count);
    this.object.material.uniforms.voxel_m!.value = voxel_m;
    this.object.visible = count > 0;
  }

  private normals({ voxels, count, box }: Surface, out: Int8Array): void {
    const [sx, sy] = box.size,
      inside = box.inside,
      steps = this.steps;
    NEIGHBOURS.forEach(([x, y, z], s) => (steps[s] = (z * sy + y) * sx + x));
    for (let n = 0; n < count; ++n) {
      const at =
        ((voxels[3 * n + 2]! - box.first[2]) * sy + voxels[3 * n + 1]! - box.first[1]) * sx +
        voxels[3 * n]! -
        box.first[0];
      let x = 0,
        y = 0,
        z = 0;
      for (let s = 0; s < steps.length; ++s)
        if (inside[at + steps[s]!]) {
          const step = NEIGHBOURS[s]!;
          ((x -= step[0]), (y -= step[1]), (z -= step[2]));
        }
      const scale = 127 / Math.max(1e-6, Math.sqrt(x * x + y * y + z * z));
      ((out[3 * n] = scale * x), (out[3 * n + 1] = scale * y), (out[3 * n + 2] = scale * z));
    }
  }

  private grow(count: number): void {
    this.capacity = Math.max(4096, Math.ceil(1.5 * count));
    this.object.geometry.dispose();
    const geometry = new BufferGeometry();
    const add = (name: string, array: Float32Array | Uint8Array | Int8Array, normalized: boolean) => {
      const attribute = new BufferAttribute(array, 3, normalized);
      attribute.setUsage(DynamicDrawUsage);
      geometry.setAttribute(name, attribute);
    };
    add("position", new Float32Array(3 * this.capacity), false);
    add("colour", new Uint8Array(3 * this.capacity), true);
    add("normal", new Int8Array(3 * this.capacity), true);
    geometry.boundingSphere = new Sphere(new Vector3(), 1e3); // otherwise computed for every volume
    this.object.geometry = geometry;
  }
}
