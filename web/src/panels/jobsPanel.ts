import type { Job } from "../api/documents";
import { h, replace } from "../dom";
import { count, duration, percent } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

const isLive = (job: Job): boolean => job.state === "queued" || job.state === "running";
const HISTORY = 120;

/** The jobs of the map with their progress as it happens; one can be started and cancelled. */
export class JobsPanel implements Panel {
  readonly element = h("div");
  private readonly list = h("div");
  private readonly message = h("div");
  private readonly jobs = new Map<number, Job>();
  private readonly speeds = new Map<number, number[]>();
  private readonly following = new Map<number, () => void>();

  constructor(private readonly context: MapContext) {
    this.element.append(this.startForm(), h("h3", {}, "Jobs"), this.message, this.list);
    void this.load();
  }

  update(): void {}

  dispose(): void {
    for (const stop of this.following.values()) stop();
  }

  async load(): Promise<void> {
    try {
      for (const job of await this.context.api!.jobs()) this.take(job);
      this.draw();
    } catch (error) {
      replace(this.list, trouble(error as Error, () => void this.load()));
    }
  }

  private take(job: Job): void {
    this.jobs.set(job.id, job);
    const speeds = this.speeds.get(job.id) ?? [];
    if (job.state === "running") speeds.push(job.scans_per_second);
    this.speeds.set(job.id, speeds.slice(-HISTORY));
    if (!isLive(job)) {
      this.following.get(job.id)?.();
      this.following.delete(job.id);
    } else if (!this.following.has(job.id)) {
      const stop = this.context.api!.followJob(job.id, (now) => {
        this.take(now);
        this.draw();
      });
      this.following.set(job.id, stop);
    }
  }

  private draw(): void {
    const jobs = [...this.jobs.values()].sort((a, b) => b.id - a.id);
    replace(this.list, ...(jobs.length > 0 ? jobs.map((job) => this.row(job)) : [h("p", { class: "note" }, "None yet.")]));
  }

  private row(job: Job): HTMLElement {
    const bar = h("progress", { max: 1, "aria-label": `Progress of job ${job.id}` });
    if (job.progress !== null) bar.value = job.progress;
    const scans = job.scans_total > 0 ? `${job.scans_done} of ${count(job.scans_total, "scan")}` : count(job.scans_done, "scan");
    const speed = job.state === "running" ? `, ${job.scans_per_second.toFixed(1)} scans/s` : "";
    const left = job.eta_s !== null && isLive(job) ? `, ${duration(job.eta_s)} left` : "";
    return h(
      "section",
      { class: "job", "data-state": job.state },
      h("header", {}, h("b", {}, `${job.kind} ${job.session ?? ""}`), h("span", { class: "note" }, job.progress !== null && isLive(job) ? `${job.state}, ${percent(job.progress)}` : job.state)),
      isLive(job) ? bar : null,
      h("p", { class: "note" }, `${scans}, ${count(job.cells_done, "CELL")}${speed}${left}`),
      plot(this.speeds.get(job.id) ?? []),
      job.error ? h("div", { class: "box error" }, job.error.message) : null,
      isLive(job) ? h("button", { type: "button", onclick: () => void this.cancel(job.id) }, "Cancel") : null,
    );
  }

  private async cancel(id: number): Promise<void> {
    replace(this.message);
    try {
      await this.context.api!.cancelJob(id);
      await this.load();
    } catch (error) {
      replace(this.message, trouble(error as Error, () => void this.cancel(id)));
    }
  }

  private startForm(): HTMLElement {
    const path = h("input", { type: "text", name: "path", required: true, autocomplete: "off" });
    const session = h("input", { type: "text", name: "session", autocomplete: "off" });
    const message = h("div");
    const form = h(
      "form",
      {},
      h("label", { class: "field" }, h("span", {}, "Folder of the drive, on the server (below a --data-root)"), path),
      h("label", { class: "field" }, h("span", {}, "Session (its name in the map; else the folder's)"), session),
      h("div", { class: "actions" }, h("button", { class: "primary", type: "submit" }, "Start ingest")),
    );
    const start = (): void => {
      this.context.api!.startIngest(path.value.trim(), session.value.trim()).then(
        (job) => {
          replace(message);
          this.take(job);
          this.draw();
        },
        (error: Error) => replace(message, trouble(error, start)),
      );
    };
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      start();
    });
    return h("details", {}, h("summary", {}, "Map another drive"), form, message);
  }
}

/** Scans a second, as they went by. */
function plot(speeds: number[]): HTMLElement | null {
  if (speeds.length < 3) return null;
  const top = Math.max(...speeds, 1);
  const points = speeds.map((speed, i) => `${((100 * i) / (speeds.length - 1)).toFixed(1)},${(40 - (36 * speed) / top).toFixed(1)}`);
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  picture.setAttribute("class", "plot");
  picture.setAttribute("viewBox", "0 0 100 42");
  picture.setAttribute("preserveAspectRatio", "none");
  picture.setAttribute("role", "img");
  picture.setAttribute("aria-label", `Scans a second, up to ${top.toFixed(1)}`);
  const line = document.createElementNS("http://www.w3.org/2000/svg", "polyline");
  line.setAttribute("points", points.join(" "));
  picture.append(line);
  return picture as unknown as HTMLElement;
}
