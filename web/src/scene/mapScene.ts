import { Box3, Frustum, type Matrix4, Matrix4 as M4, type Object3D, Vector3 } from "three";

import { Lattices, type LatticeId } from "../format/lattice";
import type { MapModel } from "../model/mapModel";
import type { SessionColours } from "../model/sessionColours";
import type { Layers, SceneActions } from "../panels/panel";
import { themeColour } from "../theme";
import { GraphLayer, type Picked } from "./graphLayer";
import { groundGrid } from "./ground";
import { type CellChange, PatchLayer } from "./patchLayer";
import type { Colouring } from "./patchMaterial";
import { interpolated, positionOf } from "./poses";
import { ScanLayer } from "./scanLayer";
import { SPHERE_M, SphereLayer } from "./sphereLayer";
import { Stage, type View } from "./stage";
import { type CellSource, Streamer, type StreamerState } from "./streamer";

export interface MapSceneOptions {
  lattice: LatticeId;
  source: CellSource;
  colours: SessionColours;
  /** Patches drawn at a time; undefined: by what the machine manages. */
  budget: number | undefined;
  /** Whether CELLs travel coded. */
  coded: boolean;
  onPick: (picked: Picked | null) => void;
  onState: (state: StreamerState) => void;
}

const HARDWARE_BUDGET = 600_000;
const SOFTWARE_BUDGET = 18_000;
const BUDGET_RANGE = [10_000, 3_000_000] as const;
const MEMORY_BYTES = 192 << 20;

/** A map in 3D: patches, graph, ground, and whatever lies over them. */
export class MapScene implements SceneActions {
  readonly stage: Stage;
  private readonly patches: PatchLayer;
  private readonly graph: GraphLayer;
  private readonly scan = new ScanLayer();
  private readonly sphere = new SphereLayer();
  private readonly streamer: Streamer;
  private readonly lattices = new Lattices();
  private grid: Object3D | null = null;
  private model: MapModel | null = null;
  private closeUp: number | null = null;
  private layers: Layers | null = null;
  private readonly marks = new Set<string>();

  constructor(
    canvas: HTMLCanvasElement,
    private readonly options: MapSceneOptions,
  ) {
    this.stage = new Stage(canvas);
    this.patches = new PatchLayer(options.colours.of);
    this.graph = new GraphLayer(this.stage, options.colours.of);
    const budget = options.budget ?? (this.stage.drawsInSoftware ? SOFTWARE_BUDGET : HARDWARE_BUDGET);
    this.streamer = new Streamer(this.stage, this.patches, options.source, { budget, memory: MEMORY_BYTES, coded: options.coded }, () => this.changed());
    this.stage.scene.add(this.patches.group, this.graph.group, this.scan.group, this.sphere.group);
    this.listenToClicks(canvas);
    this.applyTheme();
  }

  /** Shows the model; CELLs that moved glide from where they were. */
  setModel(model: MapModel, before: Map<number, Matrix4> = new Map()): void {
    this.model = model;
    this.streamer.setCells([...model.cells.values()]);
    const heights = [...model.cells.values()].map(({ pose }) => positionOf(pose).z).sort((a, b) => a - b);
    if (heights.length > 0) this.patches.setHeights(heights[0]! - 2.5, heights.at(-1)! + 9);
    const ids = [...model.cells.keys()].sort((a, b) => a - b);
    this.patches.setAges(new Map(ids.map((id, i) => [id, i / Math.max(1, ids.length - 1)])));
    this.drawGrid();
    if (before.size === 0) return this.graph.update(model);
    this.stage.animate(900, (t) => {
      const poses = new Map([...before].map(([id, from]) => [id, interpolated(from, model.cells.get(id)?.pose ?? from, t)]));
      for (const [id, pose] of poses) this.patches.setPose(id, pose);
      this.graph.update(model, poses);
    });
  }

  setLayers(layers: Layers): void {
    this.layers = layers;
    this.patches.group.visible = layers.patches;
    if (this.grid) this.grid.visible = layers.grid && this.closeUp === null;
    const alone = this.closeUp !== null;
    this.graph.show({
      trajectory: layers.trajectory && !alone,
      constraints: layers.constraints && !alone,
      loops: layers.loops && !alone,
    });
  }

  setColouring(colouring: Colouring): void {
    this.patches.setColouring(colouring);
    this.stage.requestFrame();
  }

  select(selection: { loop: number | null; cell: number | null }): void {
    this.graph.select(selection);
    if (this.closeUp !== null && selection.cell !== this.closeUp) this.showSphere(null, 1);
  }

  applyTheme(): void {
    this.stage.setBackground(themeColour("ground"));
    this.drawGrid();
  }

  /** All of the map from the south, at a slope. */
  overview(): View {
    const bounds = this.bounds();
    const target = bounds.getCenter(new Vector3());
    const span = Math.max(40, bounds.max.x - bounds.min.x, (bounds.max.y - bounds.min.y) * this.stage.camera.aspect) + 24;
    const distance = span / (2 * Math.tan((this.stage.camera.fov * Math.PI) / 360) * this.stage.camera.aspect);
    return { eye: [target.x, target.y - 0.55 * distance, target.z + 0.9 * distance], target: target.toArray() };
  }

  showChanges(changes: Map<number, CellChange>): void {
    this.patches.setChanges(changes);
    this.stage.requestFrame();
  }

  lookAt([x, y, z]: [number, number, number]): void {
    this.stage.flyTo({ eye: [x - 14, y - 20, z + 24], target: [x, y, z] });
  }

  lookAtCell(id: number): void {
    const cell = this.model?.cells.get(id);
    if (!cell) return;
    const { x, y, z } = positionOf(cell.pose);
    this.stage.flyTo({ eye: [x - 18, y - 26, z + 30], target: [x, y, z] });
  }

  showSphere(id: number | null, morph: number): void {
    const entering = id !== null && this.closeUp !== id;
    const cell = id === null ? undefined : this.model?.cells.get(id);
    this.closeUp = cell ? id : null;
    this.patches.setCloseUp(this.closeUp, morph);
    if (cell && entering) {
      this.streamer.pin(id);
      const { x, y, z } = positionOf(cell.pose);
      const away = 4.2 * SPHERE_M;
      this.stage.flyTo({ eye: [x - 0.5 * away, y - 0.7 * away, z + 0.5 * away], target: [x, y, z] });
      this.showRays();
    }
    if (!cell) {
      this.streamer.pin(null);
      this.sphere.hide();
    }
    this.sphere.setMorph(morph);
    if (this.layers) this.setLayers(this.layers);
    this.stage.requestFrame();
  }

  showScan(points: Float32Array | null, pose: Matrix4 | null, found: boolean): void {
    if (!points || !pose) {
      this.scan.clear();
      this.stage.requestFrame();
      return;
    }
    this.scan.show(points, pose, found);
    const { x, y, z } = positionOf(pose);
    this.stage.flyTo({ eye: [x - 16, y - 24, z + 34], target: [x, y, z] });
  }

  /** Why no CELLs come, or null. */
  get failure(): Error | null {
    return this.streamer.state.failure;
  }

  retry(): void {
    this.streamer.retry();
  }

  /** For the figures in the corner, and for tests. */
  figures(): { patches: number; loaded: number; wanted: number; broken: Map<number, string> } {
    const { camera } = this.stage;
    const frustum = new Frustum().setFromProjectionMatrix(new M4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const { loaded, wanted, broken } = this.streamer.state;
    return { patches: this.patches.drawnPatches(frustum), loaded, wanted, broken };
  }

  dispose(): void {
    this.streamer.dispose();
    this.stage.dispose();
  }

  /** For measurements: when half of the CELLs in sight were drawn, and when all were. */
  private markProgress({ loaded, wanted }: StreamerState): void {
    const reached = [wanted > 0 && loaded >= wanted / 2 && "cellmap-picture", wanted > 0 && loaded === wanted && "cellmap-complete"];
    for (const name of reached) {
      if (!name || this.marks.has(name)) continue;
      this.marks.add(name);
      // The frame after next: by then the one that draws them is on the screen.
      requestAnimationFrame(() => requestAnimationFrame(() => performance.mark(name)));
    }
  }

  private changed(): void {
    this.adaptBudget();
    this.markProgress(this.streamer.state);
    if (this.closeUp !== null && !this.sphere.group.visible) this.showRays();
    this.options.onState(this.streamer.state);
  }

  /** Draws more where frames are quick, less where they are slow; software drawing has its own budget. */
  private adaptBudget(): void {
    const { options } = this.streamer;
    if (this.options.budget !== undefined || this.stage.drawsInSoftware || this.stage.frameMs === 0) return;
    const factor = this.stage.frameMs > 40 ? 0.8 : this.stage.frameMs < 18 ? 1.1 : 1;
    options.budget = Math.min(BUDGET_RANGE[1], Math.max(BUDGET_RANGE[0], options.budget * factor));
  }

  private showRays(): void {
    const cell = this.closeUp === null ? undefined : this.model?.cells.get(this.closeUp);
    const patches = cell && this.patches.patchesOf(cell.id);
    if (!cell || !patches) return;
    this.sphere.show(this.lattices.get(this.options.lattice), patches, cell.pose, themeColour("accent"));
    this.stage.requestFrame();
  }

  private bounds(): Box3 {
    const box = new Box3();
    for (const { pose } of this.model?.cells.values() ?? []) box.expandByPoint(positionOf(pose));
    return box.isEmpty() ? new Box3(new Vector3(-20, -20, 0), new Vector3(20, 20, 0)) : box;
  }

  private drawGrid(): void {
    if (this.grid) this.stage.scene.remove(this.grid);
    this.grid = groundGrid(this.bounds(), themeColour("line"));
    this.grid.visible = (this.layers?.grid ?? true) && this.closeUp === null;
    this.stage.scene.add(this.grid);
  }

  /** A click is a press that did not move. */
  private listenToClicks(canvas: HTMLCanvasElement): void {
    let down = { x: 0, y: 0 };
    canvas.addEventListener("pointerdown", ({ offsetX: x, offsetY: y }) => (down = { x, y }));
    canvas.addEventListener("pointerup", ({ offsetX: x, offsetY: y, button }) => {
      if (button !== 0 || this.closeUp !== null || Math.hypot(x - down.x, y - down.y) > 4) return;
      this.options.onPick(this.graph.pick(x, y));
    });
  }
}
