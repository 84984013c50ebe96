import type { Comparison, ComparisonRow } from "../api/documents";
import { h, replace } from "../dom";
import { plotFrame, svg } from "../plot";
import { count, large, metres } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

type Placed = ComparisonRow & { bytes_per_m: number; registration_error_m: number };

const FAMILIES: [string, RegExp][] = [
  ["cells", /^CELL/],
  ["clouds", /voxel|raw points/i],
  ["surfels", /surfel/i],
  ["mesh", /mesh/i],
  ["other", /./],
];

/** Which colour a row has: its kind of map. */
export function familyOf(name: string): string {
  return FAMILIES.find(([, pattern]) => pattern.test(name))![0];
}

const isPlaced = (row: ComparisonRow): row is Placed => row.bytes_per_m !== null && row.bytes_per_m > 0 && row.registration_error_m !== null && row.registration_error_m > 0;

/** Rows that no other beats in both size and error, the smallest first. */
export function frontier(rows: Placed[]): Placed[] {
  const best: Placed[] = [];
  for (const row of [...rows].sort((a, b) => a.bytes_per_m - b.bytes_per_m || a.registration_error_m - b.registration_error_m)) {
    if (best.length === 0 || row.registration_error_m < best.at(-1)!.registration_error_m) best.push(row);
  }
  return best;
}

/** How CELLs compare with other ways to keep a map: size against error, and the whole table. */
export class ComparePanel implements Panel {
  readonly element = h("div");
  readonly sheet = h("div", { class: "sheet", tabindex: 0, role: "region", "aria-label": "Comparison" });

  constructor(private readonly context: MapContext) {
    void this.load();
  }

  update(): void {}

  private async load(): Promise<void> {
    replace(this.element, h("p", { class: "note" }, "Asking for the comparison..."));
    try {
      const comparison = await this.context.api!.comparison();
      if (comparison) this.show(comparison);
      else this.showNothing();
    } catch (error) {
      replace(this.element, trouble(error as Error, () => void this.load()));
    }
  }

  private showNothing(): void {
    const command = `cellmap compare DRIVE --server ${location.origin} --map ${this.context.summary.name}`;
    replace(this.element, h("p", {}, "Nobody has compared this map with other representations yet."), h("pre", {}, h("code", {}, command)));
    replace(this.sheet, h("h2", {}, "No comparison yet"), h("p", {}, "It builds maps of many kinds from the same scans and measures size and error of each:"), h("pre", {}, h("code", {}, command)));
  }

  private show(comparison: Comparison): void {
    const placed = comparison.rows.filter(isPlaced);
    replace(
      this.element,
      h("p", {}, `${comparison.dataset}: ${count(comparison.scans, "scan")} over ${metres(comparison.length_m)}, ${comparison.held_back} of them held back and registered to each map.`),
      h("p", { class: "note" }, "A row is better the further it lies to the left (smaller) and below (a scan is placed with less error). The line joins those that no other beats in both."),
      h("ul", { class: "list legend" }, ...FAMILIES.map(([family]) => h("li", {}, h("span", { class: `dot ${family}` }), family))),
    );
    replace(this.sheet, h("h2", {}, "Size against error"), placed.length > 1 ? (sizeAgainstError(placed) as unknown as HTMLElement) : null, table(comparison.rows));
  }
}

function sizeAgainstError(rows: Placed[]): SVGElement {
  const sizes = rows.map((row) => row.bytes_per_m);
  const errors = rows.map((row) => 1000 * row.registration_error_m);
  const plot = plotFrame(
    760,
    400,
    { label: "bytes a metre driven", low: Math.min(...sizes) / 1.5, high: Math.max(...sizes) * 1.5, log: true, format: large },
    { label: "a scan is off by, mm", low: 0, high: Math.max(...errors) * 1.1, format: (mm) => mm.toFixed(0) },
    `${rows.length} kinds of map by bytes a metre and registration error; the table below has the figures`,
  );
  const best = frontier(rows);
  plot.element.append(
    svg("polyline", { class: "frontier", points: best.map((row) => `${plot.x(row.bytes_per_m)},${plot.y(1000 * row.registration_error_m)}`).join(" ") }),
  );
  for (const row of rows) {
    const [x, y] = [plot.x(row.bytes_per_m), plot.y(1000 * row.registration_error_m)];
    const text = `${row.name}: ${large(row.bytes_per_m)} B/m, ${(1000 * row.registration_error_m).toFixed(1)} mm`;
    plot.element.append(svg("circle", { class: `dot ${familyOf(row.name)}`, cx: x, cy: y, r: 5 }, svg("title", {}, text)));
    const anchor = x > 500 ? "end" : "start";
    if (best.includes(row)) plot.element.append(svg("text", { class: "tag", x: x + (x > 500 ? 4 : 8), y: y - 9, "text-anchor": anchor }, row.name));
  }
  return plot.element;
}

const COLUMNS: [string, (row: ComparisonRow) => string][] = [
  ["bytes/m", (row) => figure(row.bytes_per_m, (n) => large(Math.round(n)))],
  ["F-score 10 cm", (row) => figure(row.f_score["0.1"], (n) => n.toFixed(2))],
  ["accuracy mm", (row) => figure(row.accuracy_m, (m) => (1000 * m).toFixed(0))],
  ["completeness mm", (row) => figure(row.completeness_m, (m) => (1000 * m).toFixed(0))],
  ["scan off mm", (row) => figure(row.registration_error_m, (m) => (1000 * m).toFixed(1))],
  ["turned deg", (row) => figure(row.registration_turn_deg, (deg) => deg.toFixed(3))],
];

const figure = (value: number | null, format: (value: number) => string): string => (value === null ? "-" : format(value));

function table(rows: ComparisonRow[]): HTMLElement {
  return h(
    "table",
    {},
    h("caption", { class: "visually-hidden" }, "Kinds of map with their sizes and errors"),
    h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "map"), ...COLUMNS.map(([name]) => h("th", { scope: "col" }, name)))),
    h(
      "tbody",
      {},
      ...rows.map((row) =>
        h(
          "tr",
          { class: familyOf(row.name) },
          h("th", { scope: "row" }, h("span", { class: `dot ${familyOf(row.name)}` }), row.name, row.measured ? null : h("small", {}, row.note ? ` ${row.note}` : " published")),
          ...COLUMNS.map(([, text]) => h("td", {}, text(row))),
        ),
      ),
    ),
  );
}
