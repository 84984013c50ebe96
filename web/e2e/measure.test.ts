import { readFileSync } from "node:fs";
import { expect, test } from "vitest";

import { Browser, screenshot } from "./browser";
import { Cellmapd } from "./cellmapd";

// Not a test: `web/run.sh measure` prints what a page costs on a map of your own.
const { CELLMAP_MEASURE_STORE: store, CELLMAP_MEASURE_MAP: map } = process.env;

interface Cost {
  query: string;
  picture_s: number;
  complete_s: number;
  renderer_mb: number;
  gpu_mb: number;
  heap_mb: number;
  received_mb: number;
  cells: number;
  page_cpu_s: number;
  gpu_cpu_s: number;
  server_cpu_s: number;
}

/** Memory of a process that no other has, and its share of what several have, MB. */
function proportionalMb(pid: number): number {
  return Number(/^Pss:\s+(\d+) kB/m.exec(readFileSync(`/proc/${pid}/smaps_rollup`, "utf8"))![1]) / 1000;
}

async function costOf(server: Cellmapd, query: string): Promise<Cost> {
  const browser = await Browser.open();
  try {
    const page = await browser.page();
    const before = server.processorSeconds();
    let received = 0;
    page.on("response", (response) => void response.allHeaders().then((headers) => (received += Number(headers["content-length"] ?? 0)), () => undefined));
    await page.goto(`${server.url}/${query}#/${map}`);
    await page.waitForFunction(() => performance.getEntriesByName("cellmap-complete").length > 0, undefined, { timeout: 300_000 });
    await screenshot(page, `measure${query.replaceAll(/\W+/g, "-")}`);
    const found = await page.evaluate(() => ({
      marks: ["cellmap-picture", "cellmap-complete"].map((name) => performance.getEntriesByName(name)[0]!.startTime / 1000),
      heap: (performance as unknown as { memory: { usedJSHeapSize: number } }).memory.usedJSHeapSize / 1e6,
      cells: (window as unknown as { cellmapScene: { figures(): { loaded: number } } }).cellmapScene.figures().loaded,
    }));
    const processes = await browser.processes();
    const memory = (type: string): number => processes.filter((one) => one.type === type).reduce((sum, { id }) => sum + proportionalMb(id), 0);
    const processor = (type: string): number => processes.filter((one) => one.type === type).reduce((sum, { cpuTime }) => sum + cpuTime, 0);
    return {
      query: query || "(plain)",
      picture_s: found.marks[0]!,
      complete_s: found.marks[1]!,
      renderer_mb: memory("renderer"),
      gpu_mb: memory("GPU"),
      heap_mb: found.heap,
      received_mb: received / 1e6,
      cells: found.cells,
      page_cpu_s: processor("renderer"),
      gpu_cpu_s: processor("GPU"),
      server_cpu_s: server.processorSeconds() - before,
    };
  } finally {
    await browser.close();
  }
}

test.skipIf(!store)(
  "what the page costs",
  async () => {
    const server = await Cellmapd.start(store!);
    try {
      const rows: Cost[] = [];
      for (const query of ["", "?cells=coded"]) rows.push(await costOf(server, query));
      console.table(rows.map((row) => Object.fromEntries(Object.entries(row).map(([name, value]) => [name, typeof value === "number" ? Math.round(10 * value) / 10 : value]))));
      for (const row of rows) expect(row.cells).toBeGreaterThan(0);
    } finally {
      await server.stop();
    }
  },
  900_000,
);
