import type { LoopExplanation } from "../api/documents";
import { announce, facts, h, replace, swatch } from "../dom";
import { type Verdict, verdictOf } from "../model/mapModel";
import { VERDICT_COLOURS } from "../scene/graphLayer";
import { count, metres, percent } from "../text";
import { trouble } from "../view/trouble";
import type { MapContext, Panel } from "./panel";

type StatedLoop = Pick<LoopExplanation, "id" | "from" | "to" | "origin" | "scores" | "pinned" | "verdict"> & Partial<LoopExplanation>;

const MEANING: Record<Verdict, string> = {
  accepted: "It agrees with the rest of the map and counts in full.",
  pinned: "Held for certain by a user; it is not judged.",
  weakened: "It disagrees a little with the rest and counts in part.",
  rejected: "It contradicts the rest of the map and does not count.",
  trusted: "It ties neighbours of a drive, which are not judged.",
};

/** The loops of the map; the selected one with its evidence, to pin or to delete. */
export class LoopPanel implements Panel {
  readonly element = h("div");
  private readonly chosen = h("div");
  private readonly list = h("div");
  private shown: string | null = null;
  private message: HTMLElement | null = null;

  constructor(private readonly context: MapContext) {
    this.element.append(this.chosen, this.list);
    this.update();
  }

  update(): void {
    const { model, selection } = this.context;
    const key = `${selection.loop} ${model.revision}`;
    if (key !== this.shown) {
      this.shown = key;
      if (selection.loop === null) replace(this.chosen, this.message);
      else void this.explain(selection.loop);
    }
    const loops = model.loops;
    replace(
      this.list,
      h("h3", {}, count(loops.length, "loop")),
      loops.length === 0
        ? h("p", { class: "note" }, "No place was met twice yet. When one is, the closure appears here and the map bends to it.")
        : h("ul", { class: "list" }, ...loops.map((loop) => this.row(loop.id, loop.from, loop.to, verdictOf(loop)))),
    );
  }

  private row(id: number, from: number, to: number, verdict: Verdict): HTMLElement {
    const pressed = this.context.selection.loop === id;
    return h(
      "li",
      {},
      h(
        "button",
        { type: "button", "aria-pressed": String(pressed), onclick: () => this.context.select({ loop: pressed ? null : id }) },
        swatch(VERDICT_COLOURS[verdict]!),
        h("span", { class: "grow" }, `CELL ${from} - CELL ${to}`),
        h("small", {}, verdict),
      ),
    );
  }

  private async explain(id: number): Promise<void> {
    try {
      const loop = this.context.api ? await this.context.api.loop(id) : this.stated(id);
      if (this.context.selection.loop === id) replace(this.chosen, this.message, this.evidence(loop));
    } catch (error) {
      if (this.context.selection.loop === id) replace(this.chosen, trouble(error as Error, () => void this.explain(id)));
    }
  }

  /** What an archive says of a loop: all but how it stands at the poses of now. */
  private stated(id: number): StatedLoop {
    const loop = this.context.model.constraints.get(id);
    if (!loop) throw new Error(`There is no loop ${id} in this map.`);
    const s = loop.scores;
    return {
      ...loop,
      verdict: verdictOf(loop),
      scores: {
        points: s.points,
        hits: s.hits,
        inlier_ratio_all: s.inlierRatioAll,
        inlier_ratio_hit: s.inlierRatioHit,
        share_in_front: s.shareInFront,
        share_beyond: s.shareBeyond,
        median_residual_m: s.medianResidualM,
      },
    };
  }

  private evidence(loop: StatedLoop): HTMLElement {
    const s = loop.scores;
    const measured = s.points > 0;
    return h(
      "section",
      { class: "box", "aria-label": `Loop ${loop.id}` },
      h("h2", {}, `Loop ${loop.id}: `, loop.verdict),
      h("p", { class: "note" }, MEANING[loop.verdict]),
      facts(
        ["Ties", `CELL ${loop.from} to CELL ${loop.to}`],
        ["Found by", loop.origin === "user" ? "a user" : loop.origin === "mapper" ? "the mapper" : "detection"],
        measured ? ["Points that meet a patch", `${percent(s.hits / s.points)} of ${s.points}`] : null,
        measured ? ["of these within the surface", percent(s.inlier_ratio_hit)] : null,
        measured ? ["Sight line blocked", percent(s.share_in_front)] : null,
        measured ? ["Median residual", metres(s.median_residual_m)] : null,
        loop.gap_m !== undefined ? ["Off by now", `${metres(loop.gap_m)}, ${loop.gap_deg!.toFixed(2)}\u00b0`] : null,
        loop.chi2 !== undefined ? ["Chi-square (true ones below 16.8)", loop.chi2.toFixed(1)] : null,
      ),
      this.context.api && h(
        "div",
        { class: "actions" },
        h("button", { type: "button", onclick: () => void this.pin(loop) }, loop.pinned ? "Unpin" : "Pin"),
        h("button", { type: "button", class: "danger", onclick: () => void this.erase(loop) }, "Delete loop"),
      ),
    );
  }

  private async pin(loop: StatedLoop): Promise<void> {
    await this.act(async () => {
      await this.context.api!.pinLoop(loop.id, !loop.pinned);
      return `Loop ${loop.id} is ${loop.pinned ? "judged like any other again" : "pinned"}.`;
    });
  }

  /** The map moves by itself when the event stream tells of the new revision. */
  private async erase(loop: StatedLoop): Promise<void> {
    await this.act(async () => {
      const { moved } = await this.context.api!.deleteLoop(loop.id);
      this.context.select({ loop: null });
      return `Loop ${loop.id} is gone; ${count(moved, "CELL")} moved.`;
    });
  }

  private async act(action: () => Promise<string>): Promise<void> {
    try {
      const done = await action();
      announce(done);
      this.message = h("div", { class: "box good" }, done);
    } catch (error) {
      this.message = trouble(error as Error, () => void this.act(action));
    }
    this.shown = null;
    this.update();
  }
}
