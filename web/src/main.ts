import { h, replace } from "./dom";
import { BlobSource, HttpSource } from "./format/byteSource";
import { archiveOf, formatRoute, parseRoute, type Route } from "./route";
import { initialTheme, setTheme } from "./theme";
import { MapListView } from "./view/mapListView";
import { MapView } from "./view/mapView";
import iconUrl from "./icon.svg";

/** A page of the viewer; `update` is called when the address changes within it. */
export interface View {
  readonly element: HTMLElement;
  /** What the header says after the name. */
  readonly where: HTMLElement;
  dispose(): void;
}

const where = h("div", { class: "where" });
const main = h("main", { id: "main" });
const themeButton = h("button", { class: "quiet", type: "button", onclick: () => toggleTheme() });

function toggleTheme(): void {
  const dark = document.documentElement.dataset.theme === "light";
  setTheme(dark ? "dark" : "light");
  nameTheme();
}

function nameTheme(): void {
  themeButton.textContent = document.documentElement.dataset.theme === "light" ? "Dark" : "Light";
  themeButton.setAttribute("aria-label", `Switch to the ${themeButton.textContent!.toLowerCase()} theme`);
}

/** Archives that were dropped or chosen: a page that is loaded anew has them no more. */
const files = new Map<string, BlobSource>();

function makeView(route: Route): View {
  const archive = archiveOf(route.map);
  if (archive === null) return route.map === null ? new MapListView(openFile) : new MapView(route);
  const source = archive.kind === "url" ? new HttpSource(new URL(archive.name, location.href).href) : files.get(archive.name);
  return source ? new MapView(route, source) : new MapListView(openFile, `${archive.name} was opened from this computer; drop it here again.`);
}

function openFile(file: File): void {
  files.set(file.name, new BlobSource(file, file.name));
  shown = undefined;
  const address = formatRoute({ ...parseRoute(""), map: `file:${file.name}` });
  if (location.hash === address) show();
  else location.hash = address;
}

/** An archive may be dropped on any page. */
function listenToArchives(): void {
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener(
    "drop",
    (event) => {
      event.preventDefault();
      const file = event.dataTransfer?.files[0];
      if (!file?.name.endsWith(".cellmap")) return;
      event.stopImmediatePropagation();
      openFile(file);
    },
    { capture: true },
  );
}

let view: View | null = null;
let shown: string | null | undefined;

function show(): void {
  const route = parseRoute(location.hash);
  if (view && shown === route.map) {
    if (view instanceof MapView) view.follow(route);
    return;
  }
  view?.dispose();
  shown = route.map;
  view = makeView(route);
  document.title = route.map === null ? "CELLmap" : `${route.map} - CELLmap`;
  replace(where, view.where);
  replace(main, view.element);
}

setTheme(initialTheme());
nameTheme();
main.style.display = "contents";
document.querySelector("#app")!.append(
  h(
    "header",
    { class: "bar" },
    h("a", { class: "brand", href: formatRoute(parseRoute("")), "aria-label": "CELLmap: all maps" }, h("img", { src: iconUrl, alt: "" }), "CELLmap"),
    where,
    h("div", { class: "space" }),
    h("a", { class: "note", href: "api/" }, "API"),
    themeButton,
  ),
  main,
  h("div", { id: "announcements", class: "visually-hidden", role: "status", "aria-live": "polite" }),
);
addEventListener("hashchange", show);
listenToArchives();
show();
