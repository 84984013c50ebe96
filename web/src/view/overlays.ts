import { h, replace, swatch } from "../dom";
import type { MapContext } from "../panels/panel";
import { VERDICT_COLOURS } from "../scene/graphLayer";
import { roundLength } from "../scene/ground";
import type { MapScene } from "../scene/mapScene";
import { COLOURS, type Colouring } from "../scene/patchMaterial";
import { count, large, metres } from "../text";
import { trouble } from "./trouble";

/** What lies over the canvas: colouring, legend, scale bar, figures, and what went wrong. */
export class Overlays {
  private readonly legend = h("div", { class: "glass legend" });
  private readonly scale = h("div", { class: "scale", role: "img" });
  private readonly figures = h("div", { class: "glass", "data-testid": "figures" });
  private readonly trouble = h("div");
  /** What the messages are of; they are made anew only for another reason, because one may be a form. */
  private readonly reasons: { shown: unknown[]; error: Error | null; retry: () => void } = { shown: [], error: null, retry: () => undefined };

  constructor(
    stage: HTMLElement,
    private readonly context: MapContext,
    private readonly scene: MapScene,
    private colouring: Colouring,
    private readonly onColouring: (colouring: Colouring) => void,
  ) {
    const fit = h("button", { class: "glass", type: "button", onclick: () => scene.stage.flyTo(scene.overview()) }, "Show all");
    stage.append(
      h("div", { class: "overlay top-left" }, this.colourChoice(), fit, this.trouble),
      h("div", { class: "overlay bottom-left" }, this.legend, this.scale),
      h("div", { class: "overlay bottom-right" }, this.figures),
    );
    this.drawLegend();
    this.update();
    this.updateScale();
  }

  setColouring(colouring: Colouring): void {
    if (colouring === this.colouring) return;
    this.colouring = colouring;
    const input = document.querySelector<HTMLInputElement>(`input[name="colouring"][value="${colouring}"]`);
    if (input) input.checked = true;
    this.drawLegend();
  }

  /** What else went wrong; `retry` is called when somebody wants it tried again. */
  setError(error: Error, retry: () => void): void {
    Object.assign(this.reasons, { error, retry });
    this.update();
  }

  update(): void {
    const { patches, loaded, wanted, broken } = this.scene.figures();
    const loading = loaded < wanted ? `loading ${loaded} of ${wanted} CELLs` : count(loaded, "CELL");
    replace(this.figures, `${large(patches)} patches drawn, ${loading}`);
    this.updateTrouble(broken);
  }

  private updateTrouble(broken: Map<number, string>): void {
    const isEmpty = this.context.model.cells.size === 0;
    const { failure } = this.scene;
    const { shown, error } = this.reasons;
    const now = [isEmpty, broken.size, failure, error];
    if (now.every((reason, i) => reason === shown[i])) return;
    this.reasons.shown = now;
    const tryAgain = (): void => {
      this.reasons.error = null;
      this.reasons.retry();
      this.update();
    };
    replace(
      this.trouble,
      isEmpty ? h("div", { class: "glass" }, "This map has no CELLs yet. The Jobs tab can map a drive.") : null,
      broken.size > 0 ? this.brokenCells(broken) : null,
      failure !== null ? over(trouble(failure, () => this.scene.retry())) : null,
      error !== null ? over(trouble(error, tryAgain)) : null,
    );
  }

  updateScale(): void {
    const perPixel = this.scene.stage.metresPerPixel();
    if (!Number.isFinite(perPixel) || perPixel <= 0) return;
    const length = roundLength(perPixel * 130);
    const bar = h("div");
    bar.style.width = `${length / perPixel}px`;
    const text = length < 1 ? `${Math.round(100 * length)} cm` : length < 1000 ? `${length} m` : metres(length);
    this.scale.setAttribute("aria-label", `Scale: ${text}`);
    replace(this.scale, text, bar);
  }

  private brokenCells(broken: Map<number, string>): HTMLElement {
    const [id, reason] = [...broken][0]!;
    const more = broken.size > 1 ? ` and ${broken.size - 1} more` : "";
    return h("div", { class: "glass box error", role: "alert" }, `CELL ${id}${more} cannot be shown. ${reason}`);
  }

  private colourChoice(): HTMLElement {
    return h(
      "fieldset",
      { class: "glass segmented" },
      h("legend", {}, "Colour"),
      ...COLOURS.map((colouring) => {
        const input = h("input", { type: "radio", name: "colouring", value: colouring, checked: colouring === this.colouring });
        input.addEventListener("change", () => {
          this.setColouring(colouring);
          this.onColouring(colouring);
        });
        return h("label", {}, input, h("span", {}, colouring));
      }),
    );
  }

  private drawLegend(): void {
    const { model, colours } = this.context;
    const item = (colour: string, name: string): HTMLElement => h("span", {}, swatch(colour), name);
    const patches = {
      normal: [item("#98a3af", "lying"), h("span", {}, h("span", { class: "wheel", "aria-hidden": "true" }), "standing, by the way it faces")],
      height: [h("span", {}, "low"), h("span", { class: "ramp" }), h("span", {}, "high")],
      age: [h("span", {}, "oldest"), h("span", { class: "ramp" }), h("span", {}, "newest")],
      change: [item("#e6474d", "vanished"), item("#2ebf70", "appeared"), item("#6b7580", "stayed, or not seen by both")],
      session: model.sessions.slice(0, 6).map((name) => item(colours.of(name), name)),
    }[this.colouring];
    const loops = model.loops.length > 0 ? [item(VERDICT_COLOURS.accepted!, "loop"), item(VERDICT_COLOURS.rejected!, "rejected loop")] : [];
    replace(this.legend, ...patches, ...loops);
  }
}

/** Readable over the map. */
function over(box: HTMLElement): HTMLElement {
  box.classList.add("glass");
  return box;
}
