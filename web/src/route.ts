import type { Colouring } from "./scene/patchMaterial";
import { COLOURS } from "./scene/patchMaterial";
import type { View } from "./scene/stage";

export const TABS = ["map", "graph", "drive", "locate", "jobs", "compare"] as const;
export type Tab = (typeof TABS)[number];

/** What the address says: the part after `#`, so that a link brings back what was seen. */
export interface Route {
  map: string | null;
  tab: Tab;
  cell: number | null;
  loop: number | null;
  colouring: Colouring;
  view: View | null;
  /** The map as it was; null: as it is. */
  revision: number | null;
}

const EMPTY: Route = { map: null, tab: "map", cell: null, loop: null, colouring: "normal", view: null, revision: null };

/** Names of maps hold no colon, so `archive:URL` and `file:NAME` in their place are archives. */
export function archiveOf(map: string | null): { kind: "url" | "file"; name: string } | null {
  const found = /^(archive|file):(.+)$/.exec(map ?? "");
  return found ? { kind: found[1] === "archive" ? "url" : "file", name: found[2]! } : null;
}

function readId(text: string | null): number | null {
  return text !== null && /^\d{1,10}$/.test(text) ? Number(text) : null;
}

function readView(text: string | null): View | null {
  const n = (text ?? "").split(",").map(Number);
  if (n.length !== 6 || !n.every(Number.isFinite)) return null;
  return { eye: [n[0]!, n[1]!, n[2]!], target: [n[3]!, n[4]!, n[5]!] };
}

const oneOf = <T extends string>(values: readonly T[], text: string | null, otherwise: T): T =>
  values.find((value) => value === text) ?? otherwise;

/** Whatever is not understood is left at its default. */
export function parseRoute(hash: string): Route {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?");
  if (path === "") return { ...EMPTY };
  const parameters = new URLSearchParams(query);
  return {
    map: decodeURIComponent(path),
    tab: oneOf(TABS, parameters.get("tab"), "map"),
    cell: readId(parameters.get("cell")),
    loop: readId(parameters.get("loop")),
    colouring: oneOf(COLOURS, parameters.get("colour"), "normal"),
    view: readView(parameters.get("view")),
    revision: readId(parameters.get("revision")),
  };
}

export function formatRoute({ map, tab, cell, loop, colouring, view, revision }: Route): string {
  if (map === null) return "#/";
  const parameters = new URLSearchParams();
  if (tab !== "map") parameters.set("tab", tab);
  if (cell !== null) parameters.set("cell", String(cell));
  if (loop !== null) parameters.set("loop", String(loop));
  if (colouring !== "normal") parameters.set("colour", colouring);
  if (revision !== null) parameters.set("revision", String(revision));
  if (view) parameters.set("view", [...view.eye, ...view.target].map((x) => (Math.round(10 * x) / 10 + 0).toFixed(1)).join(","));
  const query = parameters.toString().replaceAll("%2C", ",");
  return `#/${encodeURIComponent(map)}${query ? `?${query}` : ""}`;
}
