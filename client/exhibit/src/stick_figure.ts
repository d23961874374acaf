// A skeleton in the scene: one cylinder per bone, one sphere per joint. Withheld joints are not drawn.
import {
  Color,
  CylinderGeometry,
  DynamicDrawUsage,
  Group,
  InstancedMesh,
  Matrix4,
  MeshLambertMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { COLOURS } from "./palette";
import { BONES, JOINTS, sideOf, type Joints } from "./skeleton";

const BONE_M = 0.017,
  JOINT_M = 0.026,
  HEAD_M = 0.05;
const UP = new Vector3(0, 1, 0); // axis of a cylinder

export class StickFigure {
  readonly object = new Group();
  private readonly bones: InstancedMesh<CylinderGeometry, MeshLambertMaterial>;
  private readonly balls: InstancedMesh<SphereGeometry, MeshLambertMaterial>;
  private readonly from = new Vector3();
  private readonly to = new Vector3();
  private readonly rotation = new Quaternion();
  private readonly size = new Vector3();
  private readonly matrix = new Matrix4();

  /** `order`: drawn over everything of a lower order. */
  constructor(
    order: number,
    private readonly thickness = 1,
  ) {
    const material = () => new MeshLambertMaterial();
    this.bones = new InstancedMesh(
      new CylinderGeometry(BONE_M * thickness, BONE_M * thickness, 1, 12, 1),
      material(),
      BONES.length,
    );
    this.balls = new InstancedMesh(new SphereGeometry(1, 16, 10), material(), JOINTS.length);
    for (const mesh of [this.bones, this.balls]) {
      mesh.frustumCulled = false;
      mesh.renderOrder = order;
      mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      this.object.add(mesh);
    }
    // Bones are inside the body: they are drawn over the volume, with depth only among themselves.
    this.bones.onBeforeRender = (renderer) => renderer.clearDepth();
    BONES.forEach((bone, n) => this.bones.setColorAt(n, new Color(COLOURS[bone.side])));
    JOINTS.forEach((joint, n) => this.balls.setColorAt(n, new Color(COLOURS[sideOf(joint)])));
    this.object.visible = false;
  }

  hide(): void {
    this.object.visible = false;
  }

  show(joints: Joints): void {
    BONES.forEach((bone, n) => {
      const from = joints[bone.from],
        to = joints[bone.to];
      if (from && to) {
        this.from.set(...from);
        this.to.set(...to).sub(this.from);
        const length = this.to.length();
        this.rotation.setFromUnitVectors(UP, this.size.copy(this.to).divideScalar(Math.max(1e-9, length)));
        this.from.addScaledVector(this.to, 0.5);
        this.matrix.compose(this.from, this.rotation, this.size.set(1, length, 1));
      } else this.matrix.makeScale(0, 0, 0);
      this.bones.setMatrixAt(n, this.matrix);
    });
    JOINTS.forEach((joint, n) => {
      const at = joints[joint];
      const radius = (joint === "head_top" ? HEAD_M : JOINT_M) * this.thickness;
      if (at) this.matrix.makeScale(radius, radius, radius).setPosition(...at);
      else this.matrix.makeScale(0, 0, 0);
      this.balls.setMatrixAt(n, this.matrix);
    });
    this.bones.instanceMatrix.needsUpdate = this.balls.instanceMatrix.needsUpdate = true;
    this.object.visible = true;
  }
}
