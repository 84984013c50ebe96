import type { SessionDiff } from "../api/documents";
import { announce, h, replace, swatch } from "../dom";
import type { CellChange } from "../scene/patchLayer";
import { count } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

const MOST_REGIONS = 30;

/** What became of each CELL's patches; those of the earlier session vanish, those of the later one appear. */
export function changesByCell(diff: SessionDiff): Map<number, CellChange> {
  return new Map(diff.cells.map(({ id, session, changed }) => [id, { lost: session === diff.sessions[0], changed }]));
}

/** What vanished and what appeared from one session to another. Empty while the map has one session. */
export function changeBox(context: MapContext): Panel {
  const element = h("section");
  const answer = h("div", { "aria-live": "polite" });
  let shown = "";

  const ask = async (earlier: string, later: string): Promise<void> => {
    replace(answer, h("p", { class: "note" }, `Comparing ${earlier} with ${later}...`));
    try {
      const diff = await context.api!.diff(earlier, later);
      context.scene?.showChanges(changesByCell(diff));
      context.setColouring("change");
      announce(`${count(diff.regions.length, "place")} changed`);
      replace(answer, h("p", {}, `${count(diff.regions.length, "place")} changed, in ${count(diff.pairs, "pair")} of CELLs.`), regions(diff));
    } catch (error) {
      replace(answer, trouble(error as Error, () => void ask(earlier, later)));
    }
  };
  const regions = (diff: SessionDiff): HTMLElement =>
    h(
      "ul",
      { class: "list" },
      ...diff.regions.slice(0, MOST_REGIONS).map(({ change, centroid, area_m2 }) =>
        h(
          "li",
          {},
          h(
            "button",
            { type: "button", onclick: () => context.scene?.lookAt(centroid) },
            swatch(change === "vanished" ? "#e6474d" : "#2ebf70"),
            h("span", { class: "grow" }, `${change} at ${centroid[0].toFixed(0)}, ${centroid[1].toFixed(0)}`),
            h("small", {}, `${area_m2.toFixed(1)} m\u00b2`),
          ),
        ),
      ),
    );
  const update = (): void => {
    const names = context.sessions.filter(({ aligned }) => aligned).map(({ name }) => name);
    if (shown === names.join() || !context.api) return;
    shown = names.join();
    if (names.length < 2) return replace(element);
    const choice = (label: string, chosen: string): [HTMLElement, HTMLSelectElement] => {
      const select = h("select", {}, ...names.map((name) => h("option", { value: name, selected: name === chosen }, name)));
      return [h("label", { class: "field" }, h("span", {}, label), select), select];
    };
    const [fromLabel, from] = choice("Earlier session", names[0]!);
    const [toLabel, to] = choice("Later session", names[1]!);
    const button = h("button", { type: "button", onclick: () => void ask(from.value, to.value) }, "Show what changed");
    replace(element, h("h3", {}, "Change between sessions"), h("div", { class: "pair" }, fromLabel, toLabel), button, answer);
  };
  update();
  return { element, update };
}
