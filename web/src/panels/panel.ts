import type { MapSummary, Session } from "../api/documents";
import type { MapApi } from "../api/server";
import type { MapModel } from "../model/mapModel";
import type { SessionColours } from "../model/sessionColours";
import type { CellChange } from "../scene/patchLayer";
import type { Colouring } from "../scene/patchMaterial";

/** What the panels beside the canvas share: the map as it stands, and what they may ask of the view. */
export interface MapContext {
  /** Null where the map is from an archive: nothing can be asked or changed. */
  api: MapApi | null;
  summary: MapSummary;
  sessions: Session[];
  model: MapModel;
  colours: SessionColours;
  selection: { loop: number | null; cell: number | null };
  layers: Layers;
  /** Null where there is no 3D view. */
  scene: SceneActions | null;
  select(selection: { loop?: number | null; cell?: number | null }): void;
  setLayers(layers: Layers): void;
  setColouring(colouring: Colouring): void;
  /** The revision that is shown where it is not the newest. */
  past: number | null;
  /** Shows the map as it was at a revision; null: as it is. */
  showRevision(revision: number | null): Promise<void>;
}

export interface Layers {
  patches: boolean;
  trajectory: boolean;
  constraints: boolean;
  loops: boolean;
  grid: boolean;
}

/** What panels ask of the 3D view. */
export interface SceneActions {
  lookAtCell(id: number): void;
  lookAt(point: [number, number, number]): void;
  showChanges(changes: Map<number, CellChange>): void;
  showSphere(id: number | null, morph: number): void;
  showScan(points: Float32Array | null, pose: import("three").Matrix4 | null, found: boolean): void;
}

/** A tab's content; `update` is called when the map or the selection changed. */
export interface Panel {
  readonly element: HTMLElement;
  /** What is too wide for the side: lies over the 3D view while the tab is shown. */
  readonly sheet?: HTMLElement;
  update(): void;
  dispose?(): void;
}
