// Writes the API reference into public/assets, named by its content, and its address for the viewer's header.
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { parse } from "yaml";

import { renderApi } from "./render.mjs";

const source = join(process.env.CELLMAP_SOURCE_DIR, "schema/openapi.yaml");
const named = (content, suffix) => `api-${createHash("sha256").update(content).digest("hex").slice(0, 8)}.${suffix}`;

const style = readFileSync("api/style.css", "utf8");
const page = renderApi(parse(readFileSync(source, "utf8"), { merge: true }), named(style, "css"));
rmSync("public", { recursive: true, force: true });
mkdirSync("public/assets", { recursive: true });
mkdirSync("schema", { recursive: true });
writeFileSync(join("public/assets", named(style, "css")), style);
writeFileSync(join("public/assets", named(page, "html")), page);
writeFileSync("schema/apiPage.ts", `export const API_PAGE = ${JSON.stringify(`assets/${named(page, "html")}`)};\n`);
