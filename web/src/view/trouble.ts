import { ServerError } from "../api/ask";
import { setToken, token } from "../api/token";
import { type Child, h } from "../dom";

/**
 * What went wrong, in a box. Where the server wants a token, or another one, it can be given there; `retry` is called with it
 * in place, or by a button.
 */
export function trouble(error: Error, retry?: () => void, ...more: Child[]): HTMLElement {
  const status = error instanceof ServerError ? error.status : null;
  if (status === 401) {
    const heading = token() === null ? "This server asks who you are" : "The server does not take this token";
    return tokenPrompt(heading, "Whoever runs the server hands out tokens.", retry);
  }
  if (status === 403) return tokenPrompt("Your token is not good for this", `${error.message} Whoever runs the server can give you such a token.`, retry);
  const again = retry && h("button", { type: "button", onclick: retry }, "Try again");
  return h("div", { class: "box error", role: "alert" }, h("p", {}, error.message), again || more.length > 0 ? h("div", { class: "actions" }, again, ...more) : null);
}

function tokenPrompt(heading: string, reason: string, retry: (() => void) | undefined): HTMLElement {
  const input = h("input", { type: "password", name: "token", autocomplete: "off", required: true, spellcheck: "false" });
  const form = h(
    "form",
    { class: "box warn", role: "alert", "aria-label": "Token" },
    h("h2", {}, heading),
    h("p", {}, `${reason} It is kept until this tab is closed, and sent to this server only.`),
    h("label", { class: "field" }, h("span", {}, "Token"), input),
    h("div", { class: "actions" }, h("button", { class: "primary", type: "submit" }, "Continue")),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    setToken(input.value.trim());
    if (retry) retry();
    else form.remove();
  });
  return form;
}
