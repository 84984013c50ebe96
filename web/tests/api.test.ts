import { readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, test } from "vitest";
import { parse } from "yaml";

// @ts-expect-error a script of the build, without types
import { renderApi, typeOf } from "../api/render.mjs";

const source = readFileSync(join(process.env.CELLMAP_SOURCE_DIR ?? "..", "schema/openapi.yaml"), "utf8");
const document = parse(source, { merge: true });
const page: string = renderApi(document, "api.css");

test("every operation, answer and schema of openapi.yaml is on the page", () => {
  for (const [path, item] of Object.entries<Record<string, never>>(document.paths)) {
    for (const [method, op] of Object.entries<{ operationId?: string; responses: object }>(item)) {
      if (!op.operationId) continue;
      const section = page.slice(page.indexOf(`id="${op.operationId}"`)).split("</section>")[0]!;
      expect(section, `${method} ${path}`).toContain(`<code>${path}</code>`);
      for (const status of Object.keys(op.responses)) expect(section).toContain(`<b>${status}</b>`);
    }
  }
  for (const name of Object.keys(document.components.schemas)) expect(page).toContain(`id="schema-${name}"`);
});

test("every link on the page leads somewhere, and nothing is scripted or styled in place", () => {
  const ids = new Set([...page.matchAll(/id="([^"]+)"/g)].map(([, id]) => id));
  for (const [, target] of page.matchAll(/href="#([^"]+)"/g)) expect(ids).toContain(target);
  expect(page).not.toMatch(/<script|<style|style=|onclick|https?:\/\/(?!127\.0\.0\.1)/);
  expect(page).not.toContain("undefined");
  expect(page).not.toContain("[object");
});

test("what the document says is text, not markup", () => {
  expect(typeOf({ enum: ["<b>"] })).toBe("<code>&lt;b&gt;</code>");
  expect(typeOf({ type: "array", items: { $ref: "#/components/schemas/Id" }, minItems: 3, maxItems: 3 })).toContain('array of 3: <a href="#schema-Id">');
});
