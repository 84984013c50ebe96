import { BufferAttribute, BufferGeometry, Color, Group, type Matrix4, Points, PointsMaterial, Vector3 } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

import type { Constraint } from "../format/poseGraph";
import { type MapModel, verdictOf } from "../model/mapModel";
import { positionOf } from "./poses";
import type { Stage } from "./stage";

export const VERDICT_COLOURS: Record<string, string> = {
  accepted: "#2fbf71",
  pinned: "#3d8bfd",
  weakened: "#e8a33d",
  rejected: "#e5484d",
  trusted: "#8b949e",
};
const SELECTED = "#ff4fd8";
/** Lines lie a little above the ground, so that they are not lost in it. */
const LIFT_M = 0.6;

interface Segments {
  object: LineSegments2;
  width: number;
}

export type Picked = { kind: "loop"; id: number } | { kind: "cell"; id: number };

/** Trajectories, CELLs as dots, odometry and loop constraints. Drawn over the patches. */
export class GraphLayer {
  readonly group = new Group();
  private readonly trajectory = makeSegments(2.5, 0.95);
  private readonly odometry = makeSegments(1, 0.5);
  private readonly loops = makeSegments(2, 0.85);
  private readonly selected = makeSegments(5, 1);
  private readonly dots = new Points(
    new BufferGeometry(),
    new PointsMaterial({ size: 5, sizeAttenuation: false, vertexColors: true, depthTest: false, transparent: true }),
  );
  private positions = new Map<number, Vector3>();
  private constraints: Constraint[] = [];
  private selection: { loop: number | null; cell: number | null } = { loop: null, cell: null };

  constructor(
    private readonly stage: Stage,
    private readonly colourOfSession: (session: string) => string,
  ) {
    this.dots.renderOrder = 12;
    this.dots.frustumCulled = false;
    this.group.add(...[this.odometry, this.trajectory, this.loops, this.selected].map(({ object }) => object), this.dots);
  }

  /** Draws the model; `poses` replaces some of its poses, while they are on their way. */
  update(model: MapModel, poses: Map<number, Matrix4> = new Map()): void {
    this.positions = new Map();
    for (const { id, pose } of model.cells.values()) {
      const position = positionOf(poses.get(id) ?? pose);
      position.z += LIFT_M;
      this.positions.set(id, position);
    }
    this.constraints = [...model.constraints.values()];
    this.drawTrajectories(model);
    this.drawConstraints();
    this.drawDots(model);
    this.stage.requestFrame();
  }

  show(layers: { trajectory: boolean; constraints: boolean; loops: boolean }): void {
    this.trajectory.object.visible = layers.trajectory;
    this.dots.visible = layers.trajectory;
    this.odometry.object.visible = layers.constraints;
    this.loops.object.visible = layers.loops;
    this.selected.object.visible = layers.loops;
    this.stage.requestFrame();
  }

  select(selection: { loop: number | null; cell: number | null }): void {
    this.selection = selection;
    this.drawConstraints();
    this.stage.requestFrame();
  }

  position(cell: number): Vector3 | undefined {
    return this.positions.get(cell);
  }

  /** What lies under a point of the canvas: a loop within 7 pixels, else a CELL within 12. */
  pick(x: number, y: number): Picked | null {
    const at = new Map([...this.positions].map(([id, position]) => [id, this.stage.project(position)]));
    let best: Picked | null = null;
    let nearest = 7;
    if (this.loops.object.visible) {
      for (const { id, kind, from, to } of this.constraints) {
        const [a, b] = [at.get(from), at.get(to)];
        if (kind !== "loop" || !a || !b) continue;
        const distance = distanceToSegment(x, y, a, b);
        if (distance < nearest) [best, nearest] = [{ kind: "loop", id }, distance];
      }
    }
    if (best) return best;
    nearest = 12;
    for (const [id, p] of at) {
      const distance = p ? Math.hypot(p.x - x, p.y - y) : Infinity;
      if (distance < nearest) [best, nearest] = [{ kind: "cell", id }, distance];
    }
    return best;
  }

  private drawTrajectories(model: MapModel): void {
    const points: number[] = [];
    const colours: number[] = [];
    for (const session of model.sessions) {
      const drive = model.drive(session);
      for (let i = 1; i < drive.length; ++i) this.push(points, colours, drive[i - 1]!.id, drive[i]!.id, this.colourOfSession(session));
    }
    setSegments(this.trajectory, points, colours);
  }

  private drawConstraints(): void {
    const drawn = { odometry: [[], []], loops: [[], []], selected: [[], []] } as Record<string, [number[], number[]]>;
    for (const constraint of this.constraints) {
      const { id, kind, from, to } = constraint;
      const verdict = verdictOf(constraint);
      const target = kind === "loop" ? (id === this.selection.loop ? drawn.selected! : drawn.loops!) : drawn.odometry!;
      this.push(...target, from, to, id === this.selection.loop ? SELECTED : VERDICT_COLOURS[verdict]!);
    }
    setSegments(this.odometry, ...drawn.odometry!);
    setSegments(this.loops, ...drawn.loops!);
    setSegments(this.selected, ...drawn.selected!);
  }

  private drawDots(model: MapModel): void {
    const points = new Float32Array(3 * this.positions.size);
    const colours = new Float32Array(points.length);
    let i = 0;
    for (const { id, session } of model.cells.values()) {
      this.positions.get(id)!.toArray(points, i);
      new Color(this.colourOfSession(session)).toArray(colours, i);
      i += 3;
    }
    this.dots.geometry.dispose();
    this.dots.geometry = new BufferGeometry();
    this.dots.geometry.setAttribute("position", new BufferAttribute(points, 3));
    this.dots.geometry.setAttribute("color", new BufferAttribute(colours, 3));
  }

  private push(points: number[], colours: number[], from: number, to: number, colour: string): void {
    const [a, b] = [this.positions.get(from), this.positions.get(to)];
    if (!a || !b) return;
    points.push(...a.toArray(), ...b.toArray());
    const { r, g, b: blue } = new Color(colour);
    colours.push(r, g, blue, r, g, blue);
  }
}

function makeSegments(width: number, opacity: number): Segments {
  const material = new LineMaterial({ linewidth: width, vertexColors: true, transparent: true, opacity, depthTest: false });
  const object = new LineSegments2(new LineSegmentsGeometry(), material);
  object.frustumCulled = false;
  object.renderOrder = 10 + width / 10;
  return { object, width };
}

function setSegments({ object }: Segments, points: number[], colours: number[]): void {
  object.geometry.dispose();
  object.geometry = new LineSegmentsGeometry();
  if (points.length === 0) {
    object.geometry.setPositions([0, 0, 0, 0, 0, 0]);
    object.geometry.instanceCount = 0;
    return;
  }
  object.geometry.setPositions(points);
  object.geometry.setColors(colours);
}

function distanceToSegment(x: number, y: number, a: { x: number; y: number }, b: { x: number; y: number }): number {
  const [dx, dy] = [b.x - a.x, b.y - a.y];
  const t = Math.max(0, Math.min(1, ((x - a.x) * dx + (y - a.y) * dy) / (dx * dx + dy * dy || 1)));
  return Math.hypot(x - a.x - t * dx, y - a.y - t * dy);
}
