import type { Matrix4 } from "three";

import type { CellSummary } from "../api/documents";
import type { Changes } from "../format/changes";
import type { Constraint, PoseGraph } from "../format/poseGraph";
import { matrixOfArray, matrixOfPose, positionOf } from "../scene/poses";

export interface MapCell {
  id: number;
  hash: string;
  session: string;
  sequence: number;
  planes: number;
  bytes: number;
  pose: Matrix4;
}

/** How the last optimisation judged a constraint; the words of the API. */
export type Verdict = "trusted" | "pinned" | "accepted" | "weakened" | "rejected";

export function verdictOf({ kind, pinned, weight }: Constraint): Verdict {
  if (pinned) return "pinned";
  if (kind !== "loop") return "trusted";
  if (weight === 0) return "rejected";
  return weight === 1 ? "accepted" : "weakened";
}

/** A map at one revision: which CELLs, where, and what ties them. */
export class MapModel {
  revision = 0n;
  readonly cells = new Map<number, MapCell>();
  readonly constraints = new Map<number, Constraint>();
  unaligned = new Set<number>();

  static of(cells: CellSummary[], graph: PoseGraph): MapModel {
    const model = new MapModel();
    for (const { id, hash, session, sequence, planes, bytes, pose } of cells) {
      model.cells.set(id, { id, hash, session, sequence, planes, bytes, pose: matrixOfArray(pose) });
    }
    model.setGraph(graph);
    return model;
  }

  /** Takes poses and constraints of another revision. */
  setGraph(graph: PoseGraph): void {
    this.revision = graph.revision;
    graph.cells.forEach((id, i) => {
      const cell = this.cells.get(id);
      if (cell) cell.pose = matrixOfPose(graph.poses[i]!);
    });
    this.constraints.clear();
    for (const constraint of graph.constraints) this.constraints.set(constraint.id, constraint);
    this.unaligned = new Set(graph.unaligned);
  }

  /** Goes on to `changes.revision`; says which CELLs moved by more than a millimetre, and from where. */
  apply(changes: Changes): Map<number, Matrix4> {
    const before = new Map<number, Matrix4>();
    for (const id of changes.removed) this.cells.delete(id);
    for (const { cell: id, encodedBytes, T_map_cell, ...rest } of changes.added) {
      this.cells.set(id, { ...rest, id, bytes: Number(encodedBytes), pose: matrixOfPose(T_map_cell) });
    }
    for (const { cell: id, T_map_cell } of changes.moved) {
      const cell = this.cells.get(id);
      if (!cell) continue;
      const pose = matrixOfPose(T_map_cell);
      if (positionOf(pose).distanceTo(positionOf(cell.pose)) > 1e-3) before.set(id, cell.pose);
      cell.pose = pose;
    }
    for (const id of changes.removedConstraints) this.constraints.delete(id);
    for (const constraint of changes.addedConstraints) this.constraints.set(constraint.id, constraint);
    for (const { constraint, weight, pinned } of changes.judged) {
      const known = this.constraints.get(constraint);
      if (known) Object.assign(known, { weight, pinned });
    }
    this.unaligned = new Set(changes.unaligned);
    this.revision = changes.revision;
    return before;
  }

  get loops(): Constraint[] {
    return [...this.constraints.values()].filter(({ kind }) => kind === "loop");
  }

  get sessions(): string[] {
    return [...new Set([...this.cells.values()].map(({ session }) => session))].sort();
  }

  /** The CELLs of a session in the order of the drive. */
  drive(session: string): MapCell[] {
    return [...this.cells.values()].filter((cell) => cell.session === session).sort((a, b) => a.sequence - b.sequence);
  }
}
