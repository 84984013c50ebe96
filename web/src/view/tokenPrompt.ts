import { setToken, token } from "../api/token";
import { h } from "../dom";

/** Asks for the token that the server wants; `retry` is called with it in place. */
export function tokenPrompt(retry: () => void): HTMLElement {
  const input = h("input", { type: "password", id: "token", autocomplete: "off", required: true, spellcheck: "false" });
  const form = h(
    "form",
    { class: "box warn", role: "alert", "aria-label": "Token" },
    h("h2", {}, token() === null ? "This server asks who you are" : "The server does not take this token"),
    h("p", {}, "Whoever runs the server hands out tokens. This one is kept until the tab is closed, and sent to this server only."),
    h("label", { class: "field" }, h("span", {}, "Token"), input),
    h("div", { class: "actions" }, h("button", { class: "primary", type: "submit" }, "Continue")),
  );
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    setToken(input.value.trim());
    retry();
  });
  return form;
}
