import { fileURLToPath } from "node:url";
import { defineConfig } from "vitest/config";

export default defineConfig({
  base: "./",
  resolve: { alias: { "@schema": fileURLToPath(new URL("./schema", import.meta.url)) } },
  server: { proxy: { "/v1": process.env.CELLMAP_URL ?? "http://127.0.0.1:8080" } },
  build: { target: "es2022", assetsInlineLimit: 0, chunkSizeWarningLimit: 1000 },
  worker: { format: "es" },
  test: { include: ["tests/**/*.test.ts"], testTimeout: 60_000 },
});
