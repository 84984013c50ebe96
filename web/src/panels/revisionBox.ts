import { h, replace } from "../dom";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

const NOW = "The map as it is. Drag to see it as it was.";
/** A playback has at most so many pictures. */
const MOST_STEPS = 100;
const STEP_MS = 250;

const textOf = (past: number | null): string => (past === null ? NOW : `The map as it was at revision ${past}.`);

/** Before and after a loop closure, and how the map grew: a slider over its revisions, and a playback of them. */
export function revisionBox(context: MapContext): Panel {
  const newest = (): number => Number(context.model.revision);
  const slider = h("input", { type: "range", min: 1, max: newest(), value: context.past ?? newest(), "aria-label": "Revision that is shown" });
  const label = h("div", { class: "note", "aria-live": "polite" }, textOf(context.past));
  const button = h("button", { type: "button" }, "Play");
  let playing = false;

  const show = async (): Promise<void> => {
    const revision = Number(slider.value);
    const past = revision < newest() ? revision : null;
    try {
      await context.showRevision(past);
      label.textContent = textOf(past);
    } catch (error) {
      replace(label, trouble(error as Error, () => void show()));
      playing = false;
    }
  };
  const stop = (): void => {
    playing = false;
    button.textContent = "Play";
  };
  const play = async (): Promise<void> => {
    playing = true;
    button.textContent = "Stop";
    slider.max = String(newest());
    const step = Math.max(1, Math.ceil(newest() / MOST_STEPS));
    if (Number(slider.value) >= newest()) slider.value = "1";
    for (;;) {
      await show();
      if (!playing || Number(slider.value) >= newest()) break;
      await new Promise((resolve) => setTimeout(resolve, STEP_MS));
      if (!playing || !slider.isConnected) break;
      slider.value = String(Math.min(newest(), Number(slider.value) + step));
    }
    stop();
  };

  let asked: ReturnType<typeof setTimeout>;
  slider.addEventListener("input", () => {
    stop();
    slider.max = String(newest());
    clearTimeout(asked);
    asked = setTimeout(() => void show(), 60);
  });
  button.addEventListener("click", () => (playing ? stop() : void play()));
  /** After the address changed; what is being played or dragged goes first. */
  const update = (): void => {
    if (playing || Number(slider.value) === (context.past ?? Number(slider.max))) return;
    slider.max = String(newest());
    slider.value = String(context.past ?? newest());
    label.textContent = textOf(context.past);
  };
  return { element: h("section", {}, h("h3", {}, "Revisions"), slider, h("div", { class: "actions" }, button), label), update };
}
