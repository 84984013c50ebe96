import { h, replace } from "./dom";
import { formatRoute, parseRoute } from "./route";
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
const main = h("main", { style: undefined, id: "main" });
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
  view = route.map === null ? new MapListView() : new MapView(route);
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
    h("a", { class: "note", href: "openapi.yaml" }, "API"),
    themeButton,
  ),
  main,
  h("div", { id: "announcements", class: "visually-hidden", role: "status", "aria-live": "polite" }),
);
addEventListener("hashchange", show);
show();
