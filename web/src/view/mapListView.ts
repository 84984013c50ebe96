import type { MapSummary } from "../api/documents";
import { listMaps } from "../api/server";
import { h, replace } from "../dom";
import { formatRoute, parseRoute } from "../route";
import { bytes, count, large } from "../text";
import { explanation } from "./explain";
import { trouble } from "./trouble";

/** The first page: what a CELLmap is, and the maps of this server. */
export class MapListView {
  readonly where = h("span");
  readonly element = h("div", { class: "page" });
  private readonly maps = h("div", { "aria-live": "polite" }, h("p", { class: "note" }, "Asking the server for its maps..."));

  constructor(
    private readonly openFile: (file: File) => void,
    notice: string | null = null,
  ) {
    const message = notice === null ? "" : h("div", { class: "box warn", role: "status" }, notice);
    this.element.append(explanation(), message, h("h2", { class: "visually-hidden" }, "Maps"), this.maps, this.archives());
    void this.load();
  }

  /** A map that is a file needs no server. */
  private archives(): HTMLElement {
    const input = h("input", { type: "file", accept: ".cellmap", class: "visually-hidden" });
    input.addEventListener("change", () => input.files?.[0] && this.openFile(input.files[0]));
    const url = h("input", { type: "text", "aria-label": "Address of an archive", placeholder: "or its address on this server, and Enter" });
    const form = h("form", {}, url);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      if (url.value.trim()) location.hash = formatRoute({ ...parseRoute(""), map: `archive:${new URL(url.value.trim(), location.href).href}` });
    });
    return h(
      "section",
      { class: "archives" },
      h("h3", {}, "A map in a file"),
      h("label", { class: "drop" }, input, "Drop a .cellmap archive here, or choose one", h("br"), h("small", {}, "It stays on this computer.")),
      form,
    );
  }

  dispose(): void {}

  private async load(): Promise<void> {
    try {
      const maps = await listMaps();
      replace(this.maps, maps.length > 0 ? h("div", { class: "cards" }, ...maps.map(card)) : emptyServer());
    } catch (error) {
      replace(this.maps, trouble(error as Error, () => void this.load()));
    }
  }
}

function figure(value: string, name: string): [HTMLElement, HTMLElement] {
  return [h("b", {}, value), h("span", {}, name)];
}

function card(map: MapSummary): HTMLElement {
  const link = formatRoute({ ...parseRoute(""), map: map.name });
  return h(
    "a",
    { class: "card", href: link },
    h("h2", {}, map.name),
    h("div", { class: "figures" }, ...figure(large(map.cells), "CELLs"), ...figure(large(map.planes), "patches"), ...figure(bytes(map.stored_bytes), "stored")),
    h("p", { class: "note" }, `${count(map.sessions.length, "session")}, revision ${map.revision}`),
  );
}

function emptyServer(): HTMLElement {
  return h(
    "div",
    { class: "card" },
    h("h2", {}, "No maps yet"),
    h("p", {}, "Send a drive to this server, or make one with the simulator:"),
    h(
      "pre",
      {},
      h(
        "code",
        {},
        "cellmap simulate --route town --scans 300 --out drive\n" +
          `cellmap ingest drive --server ${location.origin} --map town`,
      ),
    ),
  );
}
