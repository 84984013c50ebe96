import { ServerError } from "../api/ask";
import { announce, h, replace } from "../dom";
import type { ByteSource } from "../format/byteSource";
import { type OpenedMap, openArchive, openServerMap } from "../model/origin";
import { SessionColours } from "../model/sessionColours";
import { ComparePanel } from "../panels/comparePanel";
import { DrivePanel } from "../panels/drivePanel";
import { JobsPanel } from "../panels/jobsPanel";
import { LocatePanel } from "../panels/locatePanel";
import { LoopPanel } from "../panels/loopPanel";
import { MapPanel } from "../panels/mapPanel";
import type { Layers, MapContext, Panel } from "../panels/panel";
import { formatRoute, parseRoute, type Route, type Tab, TABS } from "../route";
import { MapScene } from "../scene/mapScene";
import type { Colouring } from "../scene/patchMaterial";
import { NoWebGlError } from "../scene/stage";
import { count } from "../text";
import { listenToKeys } from "./keys";
import { Overlays } from "./overlays";
import { trouble } from "./trouble";

const TAB_NAMES: Record<Tab, string> = { map: "Map", graph: "Loops", drive: "Drives", locate: "Where am I?", jobs: "Jobs", compare: "Compare" };

/** From this machine bytes cost less than decoding; `?cells=coded` or `?cells=raw` decides otherwise. */
function travelsCoded(): boolean {
  const asked = new URLSearchParams(location.search).get("cells");
  return asked === "coded" || (asked !== "raw" && !/^(localhost|127\.[\d.]+|\[::1\])$/.test(location.hostname));
}

/** One map: the canvas with what lies over it, and the panels beside. */
export class MapView {
  readonly where = h("span");
  readonly element = h("div", { class: "work" });
  private readonly stageElement = h("div", { class: "stage", "data-drop": "Drop a scan: where was it taken?" });
  private readonly panelElement = h("div", { class: "panel", role: "tabpanel", id: "panel", tabindex: 0 });
  private readonly live = h("span", { class: "live" }, "live");
  private readonly panels: Partial<Record<Tab, Panel>> = {};
  private readonly stops: (() => void)[] = [];
  private context: MapContext | null = null;
  private scene: MapScene | null = null;
  private overlays: Overlays | null = null;
  private readonly tabs: readonly Tab[];
  private catchingUp: Promise<void> = Promise.resolve();

  /** `archive`: where the map is from, unless from this server. */
  constructor(
    private route: Route,
    private readonly archive: ByteSource | null = null,
  ) {
    const name = archive?.name ?? route.map!;
    this.tabs = archive ? ["map", "graph"] : TABS;
    this.element.append(this.stageElement, h("aside", { class: "side", "aria-label": "About this map" }, this.tabList(), this.panelElement));
    replace(this.where, "/ ", h("b", {}, name));
    this.showMessage(h("p", {}, `Opening ${name}...`));
    void this.open();
  }

  /** The address changed within the map: by a link, or by going back. */
  follow(route: Route): void {
    const view = route.view;
    this.route = route;
    this.showTab(route.tab);
    this.context?.select({ loop: route.loop, cell: route.cell });
    this.setColouring(route.colouring);
    void this.followRevision(route.revision);
    if (view) this.scene?.stage.setView(view);
  }

  dispose(): void {
    for (const stop of this.stops) stop();
    for (const panel of Object.values(this.panels)) panel.dispose?.();
    this.scene?.dispose();
  }

  private async open(): Promise<void> {
    try {
      const opened = await (this.archive ? openArchive(this.archive) : openServerMap(this.route.map!));
      this.context = this.makeContext(opened);
      this.openScene(this.context, opened);
      this.showTab(this.route.tab);
      this.context.select({ loop: this.route.loop, cell: this.route.cell });
      this.listen(this.context);
      void this.followRevision(this.route.revision);
      announce(`${opened.summary.name}: ${count(opened.summary.cells, "CELL")}`);
    } catch (error) {
      this.showFailure(error as Error);
    }
  }

  private makeContext({ api, summary, sessions, model }: OpenedMap): MapContext {
    const colours = new SessionColours();
    colours.set(model.sessions);
    return {
      api,
      summary,
      sessions,
      model,
      colours,
      selection: { loop: null, cell: null },
      layers: { patches: true, trajectory: true, constraints: false, loops: true, grid: true },
      scene: null,
      past: null,
      select: (selection) => this.select(selection),
      setLayers: (layers) => this.setLayers(layers),
      setColouring: (colouring) => this.setColouring(colouring),
      showRevision: (revision) => this.showRevision(revision),
    };
  }

  private openScene(context: MapContext, { summary, source }: OpenedMap): void {
    const canvas = h("canvas", { tabindex: 0, role: "img", "aria-label": `3D view of ${summary.name}. Arrow keys move, plus and minus zoom, Q and E turn, F shows all.` });
    replace(this.stageElement, canvas);
    try {
      this.scene = new MapScene(canvas, {
        lattice: summary.lattice,
        source,
        colours: context.colours,
        coded: context.api !== null && travelsCoded(),
        budget: Number(new URLSearchParams(location.search).get("budget")) || undefined,
        onPick: (picked) => this.picked(picked),
        onState: () => this.overlays?.update(),
      });
    } catch (error) {
      this.showMessage(h("p", {}, error instanceof NoWebGlError ? error.message : String(error)));
      return;
    }
    const { scene } = this;
    context.scene = scene;
    scene.setModel(context.model);
    scene.setLayers(context.layers);
    scene.setColouring(this.route.colouring);
    this.overlays = new Overlays(this.stageElement, context, scene, this.route.colouring, (colouring) => this.setColouring(colouring));
    scene.stage.setView(this.route.view ?? scene.overview());
    scene.stage.onMoved(() => this.cameraMoved());
    listenToKeys(canvas, scene);
    // For tests: what is drawn, without reading pixels.
    Object.assign(window, { cellmapScene: scene });
  }

  private listen(context: MapContext): void {
    const retheme = (): void => this.scene?.applyTheme();
    addEventListener("themechange", retheme);
    this.stops.push(() => removeEventListener("themechange", retheme));
    if (!context.api) return;
    this.where.append(" ", this.live);
    const stop = context.api.follow(
      (revision) => {
        if (revision !== context.model.revision) this.catchUp(context);
      },
      (connected) => {
        this.live.textContent = connected ? "live" : "connection lost";
        this.live.classList.toggle("lost", !connected);
        if (connected) this.scene?.retry();
      },
    );
    this.stops.push(stop, this.listenToDrops());
  }

  /** Fetches what changed since the revision that is shown; one request at a time. */
  private catchUp(context: MapContext): void {
    this.catchingUp = this.catchingUp.then(async () => {
      try {
        const api = context.api!;
        const before = context.model.apply(await api.changes(context.model.revision));
        [context.summary, context.sessions] = await Promise.all([api.summary(), api.sessions()]);
        context.colours.set(context.model.sessions);
        if (context.past === null) this.scene?.setModel(context.model, before);
        this.overlays?.update();
        for (const panel of Object.values(this.panels)) panel.update();
        if (before.size > 0) announce(`${count(before.size, "CELL")} moved`);
      } catch (error) {
        if (error instanceof ServerError && error.status === 0) return; // the stream says so already
        this.overlays?.setError(error as Error, () => this.catchUp(context));
      }
    });
  }

  private async showRevision(revision: number | null): Promise<void> {
    const context = this.context!;
    context.past = revision;
    this.updateAddress({ revision });
    const shown = revision === null ? context.model : context.model.at(await context.api!.poseGraph(revision));
    if (context.past === revision) this.scene?.setModel(shown);
  }

  /** The revision that an address names; where there is no such one, the newest. */
  private async followRevision(revision: number | null): Promise<void> {
    const { context } = this;
    if (!context?.api || context.past === revision) return;
    await this.showRevision(revision).catch((error: Error) => {
      this.overlays?.setError(error, () => void this.showRevision(null));
    });
    this.panels.map?.update();
  }

  private select(selection: { loop?: number | null; cell?: number | null }): void {
    const context = this.context!;
    Object.assign(context.selection, selection);
    this.scene?.select(context.selection);
    for (const panel of Object.values(this.panels)) panel.update();
    if (selection.cell != null && !this.route.view) this.scene?.lookAtCell(selection.cell);
    this.updateAddress(context.selection);
  }

  private picked(picked: { kind: "loop" | "cell"; id: number } | null): void {
    if (!picked) return;
    this.showTab(picked.kind === "loop" ? "graph" : "map");
    this.select(picked.kind === "loop" ? { loop: picked.id } : { cell: picked.id });
  }

  private setColouring(colouring: Colouring): void {
    this.overlays?.setColouring(colouring);
    this.scene?.setColouring(colouring);
    this.updateAddress({ colouring });
  }

  private setLayers(layers: Layers): void {
    this.context!.layers = layers;
    this.scene?.setLayers(layers);
  }

  private cameraTimer: ReturnType<typeof setTimeout> | undefined;
  private cameraMoved(): void {
    this.overlays?.updateScale();
    clearTimeout(this.cameraTimer);
    this.cameraTimer = setTimeout(() => this.updateAddress({ view: this.scene!.stage.view }), 400);
  }

  /** Without a new entry in the history: a view is not a page. */
  private updateAddress(change: Partial<Route>): void {
    if (parseRoute(location.hash).map !== this.route.map) return;
    this.route = { ...this.route, ...change };
    history.replaceState(null, "", formatRoute(this.route));
  }

  private tabList(): HTMLElement {
    const buttons = this.tabs.map((tab) =>
      h("button", { type: "button", role: "tab", id: `tab-${tab}`, "aria-controls": "panel", onclick: () => this.showTab(tab) }, TAB_NAMES[tab]),
    );
    const list = h("div", { class: "tabs", role: "tablist" }, ...buttons);
    list.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = (this.tabs.indexOf(this.route.tab) + step + this.tabs.length) % this.tabs.length;
      this.showTab(this.tabs[next]!);
      buttons[next]!.focus();
    });
    return list;
  }

  private showTab(asked: Tab): void {
    const tab = this.tabs.includes(asked) ? asked : "map";
    for (const button of this.element.querySelectorAll<HTMLElement>('[role="tab"]')) {
      const chosen = button.id === `tab-${tab}`;
      button.setAttribute("aria-selected", String(chosen));
      button.tabIndex = chosen ? 0 : -1;
    }
    this.panelElement.setAttribute("aria-labelledby", `tab-${tab}`);
    this.updateAddress({ tab });
    if (!this.context) return;
    const panel: Panel = this.panel(tab, this.context);
    replace(this.panelElement, panel.element);
    this.stageElement.querySelector(".sheet")?.remove();
    if (panel.sheet) this.stageElement.append(panel.sheet);
  }

  private panel(tab: Tab, context: MapContext): Panel {
    const make = { map: MapPanel, graph: LoopPanel, drive: DrivePanel, locate: LocatePanel, jobs: JobsPanel, compare: ComparePanel }[tab];
    return (this.panels[tab] ??= new make(context));
  }

  private listenToDrops(): () => void {
    const over = (event: DragEvent): void => {
      event.preventDefault();
      this.stageElement.classList.add("dragging");
    };
    const leave = (event: DragEvent): void => {
      if (event.relatedTarget === null) this.stageElement.classList.remove("dragging");
    };
    const drop = (event: DragEvent): void => {
      event.preventDefault();
      this.stageElement.classList.remove("dragging");
      const file = event.dataTransfer?.files[0];
      if (!file || !this.context) return;
      this.showTab("locate");
      void (this.panel("locate", this.context) as LocatePanel).locate(file);
    };
    addEventListener("dragover", over);
    addEventListener("dragleave", leave);
    addEventListener("drop", drop);
    return () => {
      removeEventListener("dragover", over);
      removeEventListener("dragleave", leave);
      removeEventListener("drop", drop);
    };
  }

  private showMessage(...content: Node[]): void {
    replace(this.stageElement, h("div", { class: "centre" }, h("div", { class: "box", role: "status" }, ...content)));
  }

  private showFailure(error: Error): void {
    const box = trouble(error, () => void this.open(), h("a", { class: "button", href: "#/" }, "All maps"));
    const missing = error instanceof ServerError && error.status === 404;
    if (!box.querySelector("h2")) box.prepend(h("h2", {}, missing ? "There is no such map" : "The map cannot be shown"));
    replace(this.stageElement, h("div", { class: "centre" }, box));
  }
}
