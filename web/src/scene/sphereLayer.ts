import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments, type Matrix4, Points, PointsMaterial } from "three";

import type { Lattice } from "../format/lattice";
import type { PatchLayout } from "./patchLayout";

const MAX_DOTS = 6000;
const MAX_RAYS = 400;
export const SPHERE_M = 3;

/** What a CELL is: all directions of its lattice as dots on a sphere, and rays from its origin to some of its planes. */
export class SphereLayer {
  readonly group = new Group();
  private rays: LineSegments | null = null;
  private patches: PatchLayout | null = null;

  constructor() {
    this.group.matrixAutoUpdate = false;
    this.group.visible = false;
  }

  show(lattice: Lattice, patches: PatchLayout, pose: Matrix4, colour: string): void {
    this.hide();
    this.patches = patches;
    const step = Math.max(1, Math.ceil(lattice.count / MAX_DOTS));
    const dots: number[] = [];
    for (let i = 0; i < lattice.count; i += step) {
      for (let axis = 0; axis < 3; ++axis) dots.push(0.995 * SPHERE_M * lattice.directions[3 * i + axis]!);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(Float32Array.from(dots), 3));
    const sphere = new Points(geometry, new PointsMaterial({ color: colour, size: 1.4, sizeAttenuation: false, transparent: true, opacity: 0.5 }));
    this.rays = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: colour, transparent: true, opacity: 0.35 }));
    this.rays.frustumCulled = false;
    this.group.add(sphere, this.rays);
    this.group.matrix.copy(pose);
    this.group.matrixWorldNeedsUpdate = true;
    this.group.visible = true;
    this.setMorph(0);
  }

  /** Rays end where the patches are: 0 on the sphere, 1 at their planes. */
  setMorph(morph: number): void {
    if (!this.rays || !this.patches) return;
    const { centers } = this.patches;
    const count = centers.length / 4;
    const step = Math.max(1, Math.ceil(count / MAX_RAYS));
    const ends: number[] = [];
    for (let i = 0; i < count; i += step) {
      const range = Math.hypot(centers[4 * i]!, centers[4 * i + 1]!, centers[4 * i + 2]!);
      const scale = ((1 - morph) * SPHERE_M) / range + morph;
      ends.push(0, 0, 0);
      for (let axis = 0; axis < 3; ++axis) ends.push(scale * centers[4 * i + axis]!);
    }
    this.rays.geometry.setAttribute("position", new BufferAttribute(Float32Array.from(ends), 3));
  }

  hide(): void {
    for (const child of this.group.children) (child as Points).geometry.dispose();
    this.group.clear();
    this.group.visible = false;
    this.rays = null;
    this.patches = null;
  }
}
