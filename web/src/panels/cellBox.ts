import { facts, h } from "../dom";
import { positionOf } from "../scene/poses";
import { bytes, large } from "../text";
import type { MapContext } from "./panel";

/** The selected CELL: what it is, and its sphere of directions to play with. */
export function cellBox(context: MapContext, id: number): HTMLElement {
  const cell = context.model.cells.get(id);
  const close = h("button", { class: "quiet", type: "button", onclick: () => context.select({ cell: null }) }, "Close");
  if (!cell) {
    return h("div", { class: "box warn" }, h("p", {}, `There is no CELL ${id} in this map.`), close);
  }
  const position = positionOf(cell.pose);
  const pick = (step: number): void => {
    const drive = context.model.drive(cell.session);
    const next = drive[drive.findIndex((other) => other.id === id) + step];
    if (next) context.select({ cell: next.id });
  };
  return h(
    "section",
    { class: "box", "aria-label": `CELL ${id}` },
    h("header", { class: "actions" }, h("h2", {}, `CELL ${id}`), close),
    facts(
      ["Session", `${cell.session}, number ${cell.sequence}`],
      ["Patches", large(cell.planes)],
      ["Size", bytes(cell.bytes)],
      ["Position", `${position.x.toFixed(1)}, ${position.y.toFixed(1)}, ${position.z.toFixed(1)} m`],
      ["Hash", h("code", {}, cell.hash.slice(0, 12))],
    ),
    context.scene ? sphereControls(context, id) : null,
    h(
      "div",
      { class: "actions" },
      h("button", { type: "button", onclick: () => pick(-1) }, "Previous"),
      h("button", { type: "button", onclick: () => pick(1) }, "Next"),
    ),
  );
}

/** Pulls the patches in to the sphere of directions and lets them go out along their rays again. */
function sphereControls(context: MapContext, id: number): HTMLElement {
  const slider = h("input", { type: "range", min: 0, max: 100, value: 100, "aria-label": "From the sphere of directions to the planes" });
  const alone = h("input", { type: "checkbox" });
  const explain = h(
    "p",
    { class: "note" },
    "Each dot is a direction of the lattice. A patch slides out along its ray until it meets the surface that was seen there.",
  );
  const details = h("div", { hidden: true }, h("label", { class: "field" }, h("span", {}, "Sphere to planes"), slider), explain);
  const apply = (): void => {
    details.hidden = !alone.checked;
    context.scene?.showSphere(alone.checked ? id : null, Number(slider.value) / 100);
  };
  alone.addEventListener("change", () => {
    if (alone.checked) slider.value = "0";
    apply();
  });
  slider.addEventListener("input", apply);
  return h("div", {}, h("label", { class: "check" }, alone, "Up close: the sphere and its rays"), details);
}
