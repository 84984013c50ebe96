import {
  BufferAttribute,
  Color,
  Frustum,
  Group,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  type Matrix4,
  Mesh,
  type ShaderMaterial,
  Sphere,
  Vector3,
} from "three";

import { type Colouring, COLOURS, makePatchMaterial } from "./patchMaterial";
import { LEVELS, type PatchLayout } from "./patchLayout";

const SIDES = 6;
/** A hexagon of the same area as the disc of radius 1. */
const CORNER = Math.sqrt((2 * Math.PI) / (SIDES * Math.sin((2 * Math.PI) / SIDES)));

/** What became of a CELL's patches between two sessions: the lattice points that changed, and how. */
export interface CellChange {
  lost: boolean;
  changed: number[];
}
const [VANISHED, APPEARED] = [1, 2];

interface DrawnCell {
  mesh: Mesh<InstancedBufferGeometry, ShaderMaterial>;
  patches: PatchLayout;
  session: string;
  lodScale: number;
  reach: number;
}

/** Seen from far, what a CELL saw from far is left to the CELLs near it, metres by level of detail. */
const REACH_M = [1e9, 70, 50, 40, 32, 28, 25, 22];

/** The patches of those CELLs that are in memory: one instanced mesh a CELL, drawn from a level of detail on. */
export class PatchLayer {
  readonly group = new Group();
  private readonly material = makePatchMaterial();
  private readonly drawn = new Map<number, DrawnCell>();
  private readonly corners: BufferAttribute;
  private readonly fan: BufferAttribute;
  private closeUp: number | null = null;
  private morph = 1;
  private ages = new Map<number, number>();
  private changes = new Map<number, CellChange>();

  constructor(private readonly colourOfSession: (session: string) => string) {
    const corners = new Float32Array(3 * SIDES);
    for (let i = 0; i < SIDES; ++i) {
      corners[3 * i] = CORNER * Math.cos((2 * Math.PI * i) / SIDES);
      corners[3 * i + 1] = CORNER * Math.sin((2 * Math.PI * i) / SIDES);
    }
    this.corners = new BufferAttribute(corners, 3);
    this.fan = new BufferAttribute(new Uint8Array([0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5]), 1);
  }

  add(id: number, patches: PatchLayout, session: string, pose: Matrix4): void {
    this.remove(id);
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", this.corners);
    geometry.setIndex(this.fan);
    geometry.setAttribute("center", new InstancedBufferAttribute(patches.centers, 4));
    geometry.setAttribute("octahedral", new InstancedBufferAttribute(patches.normals, 2, true));
    geometry.setAttribute("mark", new InstancedBufferAttribute(this.marksOf(id, patches), 1));
    geometry.instanceCount = 0;
    geometry.boundingSphere = new Sphere(new Vector3(), 90);
    const mesh = new Mesh(geometry, this.material);
    mesh.matrixAutoUpdate = false;
    mesh.matrix.copy(pose);
    mesh.matrixWorldNeedsUpdate = true;
    const cell: DrawnCell = { mesh, patches, session, lodScale: 1, reach: 1e9 };
    mesh.onBeforeRender = () => this.setUniforms(id, cell);
    this.drawn.set(id, cell);
    this.group.add(mesh);
  }

  remove(id: number): void {
    const cell = this.drawn.get(id);
    if (!cell) return;
    this.group.remove(cell.mesh);
    cell.mesh.geometry.dispose();
    this.drawn.delete(id);
  }

  has(id: number): boolean {
    return this.drawn.has(id);
  }

  /** How many patches a level has; 0 where the CELL is not in memory. */
  countAt(id: number, level: number): number {
    return this.drawn.get(id)?.patches.levels[Math.min(level, LEVELS - 1)] ?? 0;
  }

  patchesOf(id: number): PatchLayout | undefined {
    return this.drawn.get(id)?.patches;
  }

  /** Draws the CELL at a level, or not at all (null). Coarser patches are larger, so that surfaces stay closed. */
  setLevel(id: number, level: number | null): void {
    const cell = this.drawn.get(id);
    if (!cell) return;
    const count = level === null ? 0 : cell.patches.levels[Math.min(level, LEVELS - 1)]!;
    cell.mesh.geometry.instanceCount = count;
    cell.mesh.visible = count > 0 && (this.closeUp === null || this.closeUp === id);
    cell.lodScale = count > 0 ? Math.min(8, Math.sqrt(cell.patches.count / count)) : 1;
    cell.reach = REACH_M[level ?? 0]!;
  }

  setPose(id: number, pose: Matrix4): void {
    const mesh = this.drawn.get(id)?.mesh;
    if (!mesh) return;
    mesh.matrix.copy(pose);
    mesh.matrixWorldNeedsUpdate = true;
  }

  setColouring(colouring: Colouring): void {
    this.material.uniforms.colouring!.value = COLOURS.indexOf(colouring);
  }

  /** How old each CELL is: 0 the oldest, 1 the newest. */
  setAges(ages: Map<number, number>): void {
    this.ages = ages;
  }

  setChanges(changes: Map<number, CellChange>): void {
    this.changes = changes;
    for (const [id, { mesh, patches }] of this.drawn) mesh.geometry.setAttribute("mark", new InstancedBufferAttribute(this.marksOf(id, patches), 1));
  }

  setHeights(low: number, high: number): void {
    this.material.uniforms.heights!.value.set(low, high);
  }

  /** Shows one CELL alone, `morph` of the way from the sphere of directions to its planes; null: all, in place. */
  setCloseUp(id: number | null, morph: number): void {
    this.closeUp = id;
    this.morph = morph;
    for (const [other, { mesh }] of this.drawn) {
      mesh.visible = mesh.geometry.instanceCount > 0 && (id === null || id === other);
    }
  }

  /** Drawn in the last frame's frustum. */
  drawnPatches(frustum: Frustum): number {
    let count = 0;
    for (const { mesh } of this.drawn.values()) {
      if (mesh.visible && frustum.intersectsObject(mesh)) count += mesh.geometry.instanceCount;
    }
    return count;
  }

  private marksOf(id: number, { indices }: PatchLayout): Uint8Array {
    const marks = new Uint8Array(indices.length);
    const change = this.changes.get(id);
    if (!change) return marks;
    const changed = new Set(change.changed);
    indices.forEach((index, k) => {
      if (changed.has(index)) marks[k] = change.lost ? VANISHED : APPEARED;
    });
    return marks;
  }

  private setUniforms(id: number, cell: DrawnCell): void {
    const { uniforms } = this.material;
    uniforms.lodScale!.value = cell.lodScale;
    uniforms.reach!.value = cell.reach;
    uniforms.age!.value = this.ages.get(id) ?? 1;
    uniforms.morph!.value = this.closeUp === id ? this.morph : 1;
    (uniforms.colour!.value as Color).set(this.colourOfSession(cell.session));
    this.material.uniformsNeedUpdate = true;
  }
}
