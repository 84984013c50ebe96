// Writes the API reference: public/api/index.html, and its stylesheet into public/assets, named by its content.
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { parse } from "yaml";

import { renderApi } from "./render.mjs";

const source = join(process.env.CELLMAP_SOURCE_DIR, "schema/openapi.yaml");

const style = readFileSync("api/style.css", "utf8");
const styleName = `api-${createHash("sha256").update(style).digest("hex").slice(0, 8)}.css`;
const page = renderApi(parse(readFileSync(source, "utf8"), { merge: true }), `../assets/${styleName}`);
rmSync("public", { recursive: true, force: true });
mkdirSync("public/assets", { recursive: true });
mkdirSync("public/api");
writeFileSync(join("public/assets", styleName), style);
writeFileSync("public/api/index.html", page);
