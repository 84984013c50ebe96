import { facts, h, replace, swatch } from "../dom";
import { bytes, count, large } from "../text";
import { cellBox } from "./cellBox";
import { changeBox } from "./changeBox";
import { revisionBox } from "./revisionBox";
import type { Layers, MapContext, Panel } from "./panel";

const LAYER_NAMES: [keyof Layers, string][] = [
  ["patches", "Patches"],
  ["trajectory", "Trajectory and CELLs"],
  ["loops", "Loops"],
  ["constraints", "Constraints between neighbours"],
  ["grid", "Ground grid"],
];

/** Figures of the map, its sessions, what is drawn, and the selected CELL. */
export class MapPanel implements Panel {
  readonly element = h("div");
  private readonly cell = h("div");
  private readonly figures = h("div");
  private readonly sessions = h("div");
  private readonly changes: Panel;
  private readonly revisions: Panel | null;
  private shownCell: number | null = null;

  constructor(private readonly context: MapContext) {
    this.revisions = context.api && context.scene && context.model.revision > 1n ? revisionBox(context) : null;
    this.changes = changeBox(context);
    this.element.append(this.cell, this.figures, h("h3", {}, "Sessions"), this.sessions, h("h3", {}, "Shown"), this.layerChecks(), this.changes.element, this.revisions?.element ?? "");
    this.update();
  }

  update(): void {
    const { summary: map, model, selection } = this.context;
    if (selection.cell !== this.shownCell) {
      this.shownCell = selection.cell;
      replace(this.cell, selection.cell === null ? null : cellBox(this.context, selection.cell));
    }
    const smaller = map.raw_bytes > 0 && map.stored_bytes > 0 ? map.raw_bytes / map.stored_bytes : 0;
    replace(
      this.figures,
      facts(
        ["CELLs", large(model.cells.size)],
        ["Patches", large(map.planes)],
        ["Stored", bytes(map.stored_bytes)],
        smaller > 1 ? ["Scans it was made from", `${bytes(map.raw_bytes)} (${smaller.toFixed(0)} times as much)`] : null,
        ["Loops", large(model.loops.length)],
        ["Lattice", `${large(map.lattice.size)} directions${map.lattice.kind === "fibonacci-bands" ? " in bands" : ""}`],
        ["Revision", String(model.revision)],
      ),
    );
    replace(this.sessions, this.sessionList());
    this.changes.update();
    this.revisions?.update();
  }

  private sessionList(): HTMLElement {
    const { sessions, colours } = this.context;
    if (sessions.length === 0) return h("p", { class: "note" }, "No drive yet. The Jobs tab can start one.");
    return h(
      "ul",
      { class: "list" },
      ...sessions.map((session) =>
        h(
          "li",
          {},
          h(
            "button",
            { type: "button", onclick: () => this.goTo(session.name) },
            swatch(colours.of(session.name)),
            h("span", { class: "grow" }, session.name, session.robot ? h("small", {}, ` ${session.robot}`) : null),
            h("small", {}, session.aligned ? count(session.cells, "CELL") : "not aligned"),
          ),
        ),
      ),
    );
  }

  private goTo(session: string): void {
    const first = this.context.model.drive(session)[0];
    if (first) this.context.scene?.lookAtCell(first.id);
  }

  private layerChecks(): HTMLElement {
    const { context } = this;
    return h(
      "div",
      {},
      ...LAYER_NAMES.map(([layer, name]) => {
        const box = h("input", { type: "checkbox", checked: context.layers[layer] });
        box.addEventListener("change", () => context.setLayers({ ...context.layers, [layer]: box.checked }));
        return h("label", { class: "check" }, box, name);
      }),
    );
  }
}
