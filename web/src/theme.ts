export type Theme = "dark" | "light";

const KEY = "cellmap-theme";

/** What was chosen last, else what the system prefers. */
export function initialTheme(): Theme {
  try {
    const kept = localStorage.getItem(KEY);
    if (kept === "dark" || kept === "light") return kept;
  } catch {
    // A browser that keeps nothing.
  }
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

export function setTheme(theme: Theme): void {
  document.documentElement.dataset.theme = theme;
  try {
    localStorage.setItem(KEY, theme);
  } catch {
    // As above.
  }
  dispatchEvent(new Event("themechange"));
}

/** A colour of the present theme, by its name in style.css. */
export function themeColour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
