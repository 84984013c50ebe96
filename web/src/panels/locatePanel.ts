import type { Place, Relocalisation } from "../api/documents";
import { ServerError } from "../api/ask";
import { announce, facts, h, replace } from "../dom";
import { readScan } from "../format/scan";
import { matrixOfArray, yawDeg } from "../scene/poses";
import { thinnedPoints } from "../scene/scanLayer";
import { count, metres, percent } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

const MAX_BYTES = 32 << 20;
const TYPES: Record<string, string> = {
  bin: "application/octet-stream",
  cscn: "application/vnd.cellmap.scan",
  cell: "application/vnd.cellmap.cell",
};

/** What a dropped file is; throws where it cannot be sent. */
async function readFile(file: File): Promise<{ type: string; points: Float32Array | null }> {
  const suffix = file.name.split(".").pop()!.toLowerCase();
  const type = TYPES[suffix];
  if (!type) throw new Error(`Expected a scan (.bin as KITTI stores it, .cscn) or a CELL (.cell), found ${file.name}.`);
  if (file.size > MAX_BYTES) throw new Error(`${file.name} has more than 32 MiB.`);
  const content = await file.arrayBuffer();
  if (suffix === "bin") {
    if (content.byteLength === 0 || content.byteLength % 16 !== 0) {
      throw new Error(`${file.name} is no KITTI scan: its ${content.byteLength} bytes are not whole points of 16.`);
    }
    return { type, points: thinnedPoints(new Float32Array(content), 4) };
  }
  if (suffix === "cell") return { type, points: null };
  const { x, y, z } = readScan(new Uint8Array(content));
  const interleaved = new Float32Array(3 * x.length);
  x.forEach((_, i) => interleaved.set([x[i]!, y[i]!, z[i]!], 3 * i));
  return { type, points: thinnedPoints(interleaved, 3) };
}

/** "Where am I?": a scan is dropped, the server says where in the map it was taken. */
export class LocatePanel implements Panel {
  readonly element = h("div");
  private readonly answer = h("div", { "aria-live": "polite" });
  private asked = 0;

  constructor(private readonly context: MapContext) {
    const input = h("input", { type: "file", accept: ".bin,.cscn,.cell", class: "visually-hidden" });
    input.addEventListener("change", () => {
      const file = input.files?.[0];
      if (file) void this.locate(file);
      input.value = "";
    });
    this.element.append(
      h("p", {}, "Drop one scan anywhere on this page. It is found in the map without any hint of where it was taken."),
      h("label", { class: "drop" }, input, "Drop a scan here, or choose a file", h("br"), h("small", {}, ".bin (KITTI), .cscn, .cell")),
      this.answer,
    );
  }

  update(): void {}

  async locate(file: File): Promise<void> {
    const asked = ++this.asked;
    replace(this.answer, h("p", { class: "note" }, `Looking for ${file.name}...`));
    try {
      const { type, points } = await readFile(file);
      const start = performance.now();
      const found = await this.context.api!.relocalise(file, type);
      if (asked === this.asked) this.show(file.name, found, points, performance.now() - start);
    } catch (error) {
      if (asked !== this.asked) return;
      this.context.scene?.showScan(null, null, false);
      replace(this.answer, trouble(error as Error, error instanceof ServerError ? () => void this.locate(file) : undefined));
    }
  }

  private show(name: string, result: Relocalisation, points: Float32Array | null, ms: number): void {
    const best = result.found ? (result as Place) : null;
    const pose = best ? matrixOfArray(best.T_map_scan) : null;
    this.context.scene?.showScan(points ?? new Float32Array(), pose, true);
    announce(best ? `Found at CELL ${best.cell.id}` : "Not found in this map");
    replace(
      this.answer,
      best && pose
        ? h(
            "section",
            { class: "box good" },
            h("h2", {}, `Found near CELL ${best.cell.id}`),
            facts(
              ["Position", `${pose.elements[12]!.toFixed(2)}, ${pose.elements[13]!.toFixed(2)}, ${pose.elements[14]!.toFixed(2)} m`],
              ["Heading", `${yawDeg(pose).toFixed(1)}\u00b0`],
              ["Confidence", percent(best.confidence)],
              ["Points on their surface", percent(best.scores.inlier_ratio_hit)],
              ["Median residual", metres(best.scores.median_residual_m)],
              ["Confirmed by the CELLs around", percent(best.surroundings.agreement)],
            ),
            result.degenerate ? h("p", { class: "note" }, "The scene does not hold every direction of motion: along one of them the pose is vague.") : null,
          )
        : h(
            "section",
            { class: "box warn" },
            h("h2", {}, "Not found"),
            h("p", {}, "No place of this map agrees well enough with the scan. A wrong answer would be worse than none."),
          ),
      h("p", { class: "note" }, `${name}: ${count(result.cells_considered, "CELL")} considered in ${result.time_ms.toFixed(0)} ms (${ms.toFixed(0)} ms with the way there and back).`),
      result.alternatives.length > 0 ? h("h3", {}, "Places that were tried") : null,
      result.alternatives.length > 0 ? this.candidates(best, result.alternatives) : null,
    );
  }

  /** Each place with how much of the scan agrees with it. */
  private candidates(best: Place | null, others: Place[]): HTMLElement {
    const rows = (best ? [best, ...others] : others).slice(0, 12).flatMap((place) => {
      const fill = h("div", { class: "fill" });
      fill.style.width = percent(place.confidence).replace(" ", "");
      const go = (): void => this.context.scene?.lookAtCell(place.cell.id);
      return [
        h("button", { class: "quiet", type: "button", onclick: go }, `CELL ${place.cell.id}`),
        h("div", { class: "track" }, fill),
        h("span", {}, percent(place.confidence)),
      ];
    });
    return h("div", { class: "bar-chart" }, ...rows);
  }
}
