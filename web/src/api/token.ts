const KEY = "cellmap-token";

/** The token that this tab sends; forgotten when the tab is closed. */
export function token(): string | null {
  try {
    return sessionStorage.getItem(KEY);
  } catch {
    return null;
  }
}

/** An empty text forgets it. */
export function setToken(text: string): void {
  try {
    if (text) sessionStorage.setItem(KEY, text);
    else sessionStorage.removeItem(KEY);
  } catch {
    // A browser that keeps nothing asks again.
  }
}

/** Header fields for a request; no token goes to another origin than the page's. */
export function authorisation(url: string): Record<string, string> {
  const mine = token();
  return mine !== null && new URL(url, location.href).origin === location.origin ? { Authorization: `Bearer ${mine}` } : {};
}
