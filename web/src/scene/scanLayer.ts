import { BufferAttribute, BufferGeometry, ConeGeometry, Group, type Matrix4, Mesh, MeshBasicMaterial, Points, PointsMaterial } from "three";

const MAX_POINTS = 20_000;

/** A scan at the pose where it was found: its points, and an arrow where the sensor was and looked. */
export class ScanLayer {
  readonly group = new Group();

  constructor() {
    this.group.matrixAutoUpdate = false;
    this.group.visible = false;
  }

  show(points: Float32Array, pose: Matrix4, found: boolean): void {
    this.clear();
    const colour = found ? "#ff4fd8" : "#e8a33d";
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(points, 3));
    const dots = new Points(geometry, new PointsMaterial({ color: colour, size: 2.5, sizeAttenuation: false }));
    dots.frustumCulled = false;
    const arrow = new Mesh(new ConeGeometry(0.7, 2.4, 20), new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true }));
    arrow.rotation.z = -Math.PI / 2; // a cone points along y, the sensor along x
    arrow.position.x = 0.8;
    arrow.renderOrder = 20;
    this.group.add(dots, arrow);
    this.group.matrix.copy(pose);
    this.group.matrixWorldNeedsUpdate = true;
    this.group.visible = true;
  }

  clear(): void {
    for (const child of this.group.children) (child as Mesh).geometry.dispose();
    this.group.clear();
    this.group.visible = false;
  }
}

/** Every so many-th point of a scan file, so that it can be drawn: x y z each. */
export function thinnedPoints(values: Float32Array, stride: number): Float32Array {
  const count = Math.floor(values.length / stride);
  const step = Math.max(1, Math.ceil(count / MAX_POINTS));
  const points: number[] = [];
  for (let i = 0; i < count; i += step) {
    const [x, y, z] = [values[i * stride]!, values[i * stride + 1]!, values[i * stride + 2]!];
    if (Number.isFinite(x) && Number.isFinite(y) && Number.isFinite(z)) points.push(x, y, z);
  }
  return Float32Array.from(points);
}
