import { Matrix4 } from "three";

import { h, replace } from "../dom";
import { bestFit, distances, errors, readTrajectory, rms, type Trajectory } from "../model/trajectory";
import { line, type Plot, plotFrame } from "../plot";
import { count, metres } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

interface Drive {
  session: string;
  before: Trajectory;
  after: Trajectory;
  /** Ground truth of the same scans, where somebody chose a file. */
  truth: Trajectory | null;
}

/** A session's trajectory before and after the back end: from above, and along the way, against the truth where it is known. */
export class DrivePanel implements Panel {
  readonly element = h("div");
  readonly sheet = h("div", { class: "sheet", tabindex: 0, role: "region", "aria-label": "Trajectories" });
  private readonly message = h("div", { "aria-live": "polite" });
  private readonly select = h("select", { "aria-label": "Session" });
  private names = "";
  private drive: Drive | null = null;

  constructor(private readonly context: MapContext) {
    this.select.addEventListener("change", () => void this.load());
    const file = h("input", { type: "file", accept: ".txt,.tum,.csv", class: "visually-hidden" });
    file.addEventListener("change", () => file.files?.[0] && void this.takeTruth(file.files[0]));
    this.element.append(
      h("label", { class: "field" }, h("span", {}, "Session"), this.select),
      h("label", { class: "drop" }, file, "Choose a file with the true poses", h("br"), h("small", {}, "KITTI or TUM, one line a scan; it stays on this computer")),
      this.message,
    );
    this.update();
  }

  update(): void {
    const names = this.context.sessions.map(({ name }) => name);
    if (names.join() === this.names) return;
    this.names = names.join();
    const chosen = this.select.value || names[0];
    replace(this.select, ...names.map((name) => h("option", { value: name, selected: name === chosen }, name)));
    if (names.length > 0) void this.load();
    else replace(this.sheet, h("h2", {}, "No drive yet"), h("p", {}, "The Jobs tab can start one."));
  }

  private async load(): Promise<void> {
    const session = this.select.value;
    try {
      const [before, after] = await Promise.all((["odometry", "corrected"] as const).map((stage) => this.context.api!.trajectory(session, stage)));
      this.drive = { session, before: readTrajectory(before!), after: readTrajectory(after!), truth: null };
      replace(this.message);
      this.draw(this.drive);
    } catch (error) {
      replace(this.message, trouble(error as Error, () => void this.load()));
    }
  }

  private async takeTruth(file: File): Promise<void> {
    if (!this.drive) return;
    try {
      const truth = readTrajectory(await file.text());
      const [has, wants] = [truth.positions.length / 3, this.drive.after.positions.length / 3];
      if (has < wants) throw new Error(`${file.name} has ${count(has, "pose")}, the session ${count(wants, "scan")}: expected one a scan.`);
      this.drive.truth = truth;
      replace(this.message);
      this.draw(this.drive);
    } catch (error) {
      replace(this.message, h("div", { class: "box error", role: "alert" }, (error as Error).message));
    }
  }

  private draw(drive: Drive): void {
    const { session, before, after, truth } = drive;
    const onto = truth ?? after;
    const fitBefore = truth ? bestFit(before, truth) : startAt(before, after);
    const fitAfter = truth ? bestFit(after, truth) : new Matrix4();
    const along = distances(after);
    const [was, is] = [errors(before, onto, fitBefore), errors(after, onto, fitAfter)];
    replace(
      this.sheet,
      h("h2", {}, `${session}: ${count(along.length, "scan")}, ${metres(along.at(-1) ?? 0)}`),
      key(truth !== null),
      fromAbove([[moved(before, fitBefore), "before"], [moved(after, fitAfter), "after"], ...(truth ? [[truth, "truth"] as [Trajectory, string]] : [])]),
      h("h3", {}, truth ? `Error along the way: rms ${metres(rms(was))} before, ${metres(rms(is))} after` : `Correction along the way: up to ${metres(Math.max(0, ...was))}`),
      alongTheWay(along, truth ? [[was, "before"], [is, "after"]] : [[was, "before"]], truth !== null),
    );
  }
}

function key(truth: boolean): HTMLElement {
  const item = (kind: string, text: string): HTMLElement => h("span", {}, h("span", { class: `stroke ${kind}` }), text);
  return h("p", { class: "note key" }, item("before", "before (odometry)"), item("after", "after"), truth ? item("truth", "truth") : null);
}

/** Both begin at the same place; odometry and map frame share their directions there. */
function startAt(from: Trajectory, to: Trajectory): Matrix4 {
  const [a, b] = [from.positions, to.positions];
  return new Matrix4().makeTranslation(b[0]! - a[0]!, b[1]! - a[1]!, b[2]! - a[2]!);
}

function moved({ stamps, positions }: Trajectory, motion: Matrix4): Trajectory {
  const m = motion.elements;
  const out = new Float64Array(positions.length);
  for (let i = 0; i < positions.length; i += 3) {
    const [x, y, z] = [positions[i]!, positions[i + 1]!, positions[i + 2]!];
    for (let axis = 0; axis < 3; ++axis) out[i + axis] = m[axis]! * x + m[4 + axis]! * y + m[8 + axis]! * z + m[12 + axis]!;
  }
  return { stamps, positions: out };
}

const [WIDTH, HEIGHT] = [760, 420];

/** The same scale along both axes. */
function fromAbove(drives: [Trajectory, string][]): HTMLElement {
  const box = { x: [Infinity, -Infinity], y: [Infinity, -Infinity] };
  for (const [{ positions }] of drives) {
    for (let i = 0; i < positions.length; i += 3) {
      box.x = [Math.min(box.x[0]!, positions[i]!), Math.max(box.x[1]!, positions[i]!)];
      box.y = [Math.min(box.y[0]!, positions[i + 1]!), Math.max(box.y[1]!, positions[i + 1]!)];
    }
  }
  const perPixel = Math.max((box.x[1]! - box.x[0]!) / (WIDTH - 110), (box.y[1]! - box.y[0]!) / (HEIGHT - 90), 0.01);
  const range = ([low, high]: number[], pixels: number): { low: number; high: number } => {
    const middle = (low! + high!) / 2;
    return { low: middle - (perPixel * pixels) / 2, high: middle + (perPixel * pixels) / 2 };
  };
  const format = (m: number): string => m.toFixed(0);
  const plot = plotFrame(WIDTH, HEIGHT, { label: "x, m", ...range(box.x, WIDTH - 72), format }, { label: "y, m", ...range(box.y, HEIGHT - 50), format }, "The drive from above");
  for (const [{ positions }, kind] of drives) {
    const points = Array.from({ length: positions.length / 3 }, (_, i) => ({ x: positions[3 * i]!, y: positions[3 * i + 1]! }));
    plot.element.append(line(plot, points, `drive ${kind}`));
  }
  return plot.element as unknown as HTMLElement;
}

function alongTheWay(along: Float64Array, rows: [Float64Array, string][], truth: boolean): HTMLElement {
  const top = Math.max(0.01, ...rows.map(([values]) => values.reduce((a, b) => Math.max(a, b), 0)));
  const plot: Plot = plotFrame(
    WIDTH,
    240,
    { label: "metres driven", low: 0, high: Math.max(1, along.at(-1) ?? 1), format: (m) => m.toFixed(0) },
    { label: truth ? "error, m" : "moved by, m", low: 0, high: 1.05 * top, format: (m) => m.toFixed(top < 1 ? 2 : 1) },
    truth ? "Error along the way, before and after" : "How far the back end moved each scan",
  );
  for (const [values, kind] of rows) plot.element.append(line(plot, [...values].map((y, i) => ({ x: along[i]!, y })), `drive ${kind}`));
  return plot.element as unknown as HTMLElement;
}
