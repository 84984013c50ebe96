import { Frustum, Matrix4, Sphere, Vector3 } from "three";

import { ServerError } from "../api/ask";
import type { AskedCell, CellForm, DecodeAnswer, DecodeRequest } from "./decode.worker";
import DecodeWorker from "./decode.worker?worker";
import { chooseDetail } from "./detail";
import type { PatchLayer } from "./patchLayer";
import { COARSE_LAYER_LEVEL, LEVELS, type PatchLayout } from "./patchLayout";
import { positionOf } from "./poses";
import type { Stage } from "./stage";

/** A CELL of the map, in memory or not. */
export interface StreamedCell {
  id: number;
  /** Another one under the same number is another CELL. */
  hash: string;
  session: string;
  planes: number;
  pose: Matrix4;
}

/** Asks the worker for CELLs: from a server, or from bytes that someone else reads. */
export type CellSource = (asked: AskedCell[]) => Promise<Omit<DecodeRequest, "ticket">>;

export interface StreamerOptions {
  /** Patches drawn at a time. */
  budget: number;
  /** Bytes of patches kept in memory. */
  memory: number;
  /** Whether bytes are dearer than time: CELLs then travel coded, those far away as their coarse layer. */
  coded: boolean;
}

export interface StreamerState {
  loaded: number;
  wanted: number;
  /** CELLs that could not be read, and why. */
  broken: Map<number, string>;
  /** Why nothing comes, for example because the server is gone. */
  failure: Error | null;
}

const BYTES_A_PATCH = 25;
const BATCH = 12;
const REQUESTS = 2;
const MAX_CELLS = 2500;
/** CELLs of a map that does not fit are kept from this level on unless they are near. */
const COARSE_LEVEL = 3;

/** Keeps what is near the camera in memory, and decides in what detail each CELL is drawn. */
export class Streamer {
  readonly state: StreamerState = { loaded: 0, wanted: 0, broken: new Map(), failure: null };
  private readonly cells = new Map<number, StreamedCell>();
  private readonly kept = new Map<number, { bytes: number; level: number; used: number }>();
  private readonly pending = new Set<number>();
  private readonly worker = new DecodeWorker();
  private readonly tickets = new Map<number, (answer: DecodeAnswer) => void>();
  private levels = new Map<number, number>();
  private nextTicket = 1;
  private running = 0;
  private clock = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private pinned: number | null = null;

  constructor(
    private readonly stage: Stage,
    private readonly layer: PatchLayer,
    private readonly source: CellSource,
    readonly options: StreamerOptions,
    private readonly onChange: () => void,
  ) {
    this.worker.addEventListener("message", (event: MessageEvent<DecodeAnswer>) => {
      this.tickets.get(event.data.ticket)?.(event.data);
      this.tickets.delete(event.data.ticket);
    });
    stage.onMoved(() => this.wake());
  }

  setCells(cells: StreamedCell[]): void {
    const hashes = new Map(cells.map(({ id, hash }) => [id, hash]));
    for (const { id, hash } of this.cells.values()) if (hashes.get(id) !== hash) this.drop(id);
    this.cells.clear();
    for (const cell of cells) {
      this.cells.set(cell.id, cell);
      this.layer.setPose(cell.id, cell.pose);
    }
    this.wake();
  }

  /** This CELL stays in memory in full detail. */
  pin(id: number | null): void {
    this.pinned = id;
    this.update();
  }

  retry(): void {
    this.state.failure = null;
    this.wake();
  }

  dispose(): void {
    clearTimeout(this.timer);
    this.worker.terminate();
  }

  /** Soon, and once for many reasons. */
  private wake(): void {
    this.timer ??= setTimeout(() => {
      this.timer = undefined;
      this.update();
    }, 80);
  }

  private update(): void {
    const visible = this.visibleCells();
    this.levels = chooseDetail(visible, this.options.budget);
    if (this.pinned !== null && this.cells.has(this.pinned)) this.levels.set(this.pinned, 0);
    ++this.clock;
    for (const id of this.kept.keys()) {
      const level = this.levels.get(id);
      this.layer.setLevel(id, level ?? null);
      if (level !== undefined) this.kept.get(id)!.used = this.clock;
    }
    this.state.wanted = this.levels.size;
    this.state.loaded = [...this.levels.keys()].filter((id) => this.kept.has(id)).length;
    this.fetchMissing();
    this.stage.requestLazyFrame();
    this.onChange();
  }

  /** The nearest CELLs in sight, nearest first. */
  private visibleCells(): { id: number; distance: number; planes: number }[] {
    const { camera } = this.stage;
    camera.updateMatrixWorld();
    const frustum = new Frustum().setFromProjectionMatrix(
      new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse),
    );
    const sphere = new Sphere(new Vector3(), 60);
    const visible: { id: number; distance: number; planes: number }[] = [];
    for (const { id, pose, planes } of this.cells.values()) {
      sphere.center.copy(positionOf(pose));
      if (this.state.broken.has(id) || !frustum.intersectsSphere(sphere)) continue;
      visible.push({ id, planes, distance: sphere.center.distanceTo(camera.position) });
    }
    return visible.sort((a, b) => a.distance - b.distance).slice(0, MAX_CELLS);
  }

  private isMissing(id: number, level: number): boolean {
    if (this.pending.has(id)) return false;
    const kept = this.kept.get(id);
    return !kept || kept.level > level;
  }

  private fetchMissing(): void {
    if (this.state.failure !== null) return;
    const missing = [...this.levels].filter(([id, level]) => this.isMissing(id, level)).map(([id]) => id);
    while (this.running < REQUESTS && missing.length > 0) void this.fetch(missing.splice(0, BATCH));
  }

  private formOf(id: number): CellForm {
    if (!this.options.coded) return "raw";
    return (this.levels.get(id) ?? 0) >= COARSE_LAYER_LEVEL ? "coarse" : "compact";
  }

  private async fetch(ids: number[]): Promise<void> {
    ++this.running;
    for (const id of ids) this.pending.add(id);
    const asked = ids.map((id) => ({ id, hash: this.cells.get(id)!.hash, form: this.formOf(id) }));
    const answer = await this.decode(asked);
    --this.running;
    for (const id of ids) this.pending.delete(id);
    if (answer.failure) this.state.failure = new ServerError(answer.failure.status, answer.failure.code, answer.failure.message);
    for (const { id, patches, error } of answer.cells) {
      const { hash, form } = asked.find((one) => one.id === id)!;
      if (this.cells.get(id)?.hash !== hash) continue; // it became another one meanwhile
      if (patches) this.keep(id, patches, form === "coarse");
      else this.state.broken.set(id, error ?? "unknown");
    }
    this.evict();
    this.wake();
  }

  private async decode(asked: AskedCell[]): Promise<DecodeAnswer> {
    const ticket = this.nextTicket++;
    try {
      const request: DecodeRequest = { ticket, ...(await this.source(asked)) };
      return await new Promise((resolve) => {
        this.tickets.set(ticket, resolve);
        this.worker.postMessage(request);
      });
    } catch (error) {
      return { ticket, cells: [], bytes: 0, failure: { status: 0, code: "internal", message: (error as Error).message } };
    }
  }

  private keep(id: number, patches: PatchLayout, coarse: boolean): void {
    const cell = this.cells.get(id);
    if (!cell) return;
    const wanted = this.levels.get(id) ?? LEVELS - 1;
    // Software copies every patch to where it draws from, also those that it does not draw.
    const keepsAll = this.fitsInMemory() && !this.stage.drawsInSoftware;
    const level = keepsAll || wanted < COARSE_LEVEL ? (coarse ? COARSE_LAYER_LEVEL : 0) : COARSE_LEVEL;
    const kept = level < COARSE_LEVEL ? patches : coarser(patches, level);
    this.layer.add(id, kept, cell.session, cell.pose);
    this.layer.setLevel(id, this.levels.get(id) ?? null);
    this.kept.set(id, { bytes: (BYTES_A_PATCH * kept.centers.length) / 4, level, used: this.clock });
  }

  private fitsInMemory(): boolean {
    let planes = 0;
    for (const cell of this.cells.values()) planes += cell.planes;
    return BYTES_A_PATCH * planes <= this.options.memory;
  }

  /** Lets go of what was not drawn for longest. */
  private evict(): void {
    let bytes = 0;
    for (const entry of this.kept.values()) bytes += entry.bytes;
    if (bytes <= this.options.memory) return;
    for (const [id, entry] of [...this.kept].sort((a, b) => a[1].used - b[1].used)) {
      if (bytes <= this.options.memory || this.levels.has(id)) break;
      bytes -= entry.bytes;
      this.drop(id);
    }
  }

  private drop(id: number): void {
    this.layer.remove(id);
    this.kept.delete(id);
    this.state.broken.delete(id);
  }
}

/** The beginning of a layout that is its level `level`; `count` stays what the whole has, by which patches grow. */
function coarser(patches: PatchLayout, level: number): PatchLayout {
  const count = patches.levels[level]!;
  return {
    ...patches,
    centers: patches.centers.slice(0, 4 * count),
    normals: patches.normals.slice(0, 2 * count),
    indices: patches.indices.slice(0, count),
    levels: patches.levels.map((n) => Math.min(n, count)),
  };
}
