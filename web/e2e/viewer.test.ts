import { readFileSync, writeFileSync } from "node:fs";
import { createServer, type ServerResponse } from "node:http";
import type { AddressInfo } from "node:net";
import { join } from "node:path";
import { afterAll, beforeAll, describe, expect, test } from "vitest";

import { Browser, cellsInSight, clickBetween, loaded, picture, screenshot } from "./browser";
import { Cellmapd } from "./cellmapd";
import { useFixture } from "./fixture";

const viewer = useFixture({ dataRoot: true });

describe("with a map", () => {
  test("the first page says what a CELLmap is and lists the maps", async () => {
    const { page } = viewer;
    await page.goto(viewer.server.url);
    await page.getByRole("link", { name: /town/ }).waitFor();
    expect(await page.getByRole("heading", { level: 1 }).textContent()).toMatch(/maps/i);
    await screenshot(page, "01-maps");
    await page.getByRole("button", { name: /theme/ }).click();
    await screenshot(page, "02-maps-light");
    await page.getByRole("button", { name: /theme/ }).click();
    await page.getByRole("link", { name: /town/ }).click();
    await loaded(page);
    expect(viewer.complaints()).toEqual([]);
  });

  test("the map is drawn, and the picture changes with the camera and the colouring", async () => {
    const { page } = viewer;
    await viewer.openMap();
    const first = await picture(page);
    expect(first.colours).toBeGreaterThan(50);
    await screenshot(page, "03-map");
    await page.locator("canvas").focus();
    for (let i = 0; i < 4; ++i) await page.keyboard.press("q");
    await page.keyboard.press("+");
    await loaded(page);
    const turned = await picture(page);
    expect(turned.name).not.toBe(first.name);
    await page.getByText("height", { exact: true }).click();
    expect((await picture(page)).name).not.toBe(turned.name);
    await screenshot(page, "04-map-height");
    expect(viewer.complaints()).toEqual([]);
  });

  test("a link brings back the view", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?colour=session&view=0,-40,30,10,0,0");
    const address = new URL(page.url());
    expect(address.hash).toContain("view=0.0,-40.0,30.0,10.0,0.0,0.0");
    expect(await page.getByRole("radio", { name: "session" }).isChecked()).toBe(true);
    const before = await picture(page);
    const again = await viewer.browser.page();
    await again.goto(page.url());
    await loaded(again);
    expect((await picture(again)).name).toBe(before.name);
    await again.close();
    expect(viewer.complaints()).toEqual([]);
  });

  test("a CELL opens: its sphere, and patches that slide out along their rays", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?cell=5");
    await page.getByRole("heading", { name: "CELL 5" }).waitFor();
    await page.getByLabel(/Up close/).check();
    await page.getByLabel(/From the sphere/).waitFor();
    await loaded(page);
    const sphere = await picture(page);
    await screenshot(page, "05-cell-sphere");
    await page.getByLabel(/From the sphere/).fill("70");
    const sliding = await picture(page);
    expect(sliding.name).not.toBe(sphere.name);
    await screenshot(page, "06-cell-planes");
    expect(viewer.complaints()).toEqual([]);
  });

  test("a dropped scan is found where it was taken", async () => {
    const { page } = viewer;
    await viewer.openMap();
    await viewer.drop(viewer.town.scan(40), "000040.bin");
    await page.getByRole("heading", { name: /Found near CELL/ }).waitFor({ timeout: 90_000 });
    await page.getByText(/000040.bin: \d+ CELLs considered in \d+ ms/).waitFor();
    const position = await page.locator(".facts dd").first().textContent();
    const [x, y] = position!.split(",").map(parseFloat) as [number, number];
    const graph = await viewer.server.json<{ cells: { pose: number[] }[] }>("/v1/maps/town/cells");
    const nearest = Math.min(...graph.cells.map(({ pose }) => Math.hypot(pose[0]! - x, pose[1]! - y)));
    expect(nearest).toBeLessThan(6.5);
    await loaded(page);
    await screenshot(page, "07-where-am-i");
    expect(viewer.complaints()).toEqual([]);
  });

  test("a file that is no scan is refused with a reason", async () => {
    const { page } = viewer;
    await viewer.openMap();
    const odd = join(viewer.town.folder, "odd.bin");
    writeFileSync(odd, "not a scan");
    await viewer.drop(odd, "odd.bin");
    await page.getByRole("alert").filter({ hasText: "whole points of 16" }).waitFor();
    await viewer.drop(odd, "picture.png");
    await page.getByRole("alert").filter({ hasText: "Expected a scan" }).waitFor();
    expect(viewer.complaints()).toEqual([]);
  });

  test("a job's progress is shown and its CELLs appear", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?tab=jobs");
    await page.getByText("Map another drive").click();
    await page.getByLabel(/Folder of the drive/).fill(join(viewer.town.folder, "drive"));
    await page.getByLabel(/Session/).fill("tuesday");
    const before = await cellsInSight(page);
    await viewer.server.slowly(async () => {
      await page.getByRole("button", { name: "Start ingest" }).click();
      await page.locator('.job[data-state="running"]').waitFor();
      await expect.poll(() => cellsInSight(page), { timeout: 150_000 }).toBeGreaterThan(before);
      await screenshot(page, "08-job");
      await page.locator('.job[data-state="succeeded"]').waitFor({ timeout: 150_000 });
    });
    await page.getByRole("img", { name: /Scans a second, up to/ }).waitFor();
    await page.getByText(/70 of 70 scans/).waitFor();
    await screenshot(page, "08-job-done");
    await page.getByRole("tab", { name: "Map" }).click();
    await page.getByRole("button", { name: /tuesday/ }).waitFor();
    expect(viewer.complaints()).toEqual([]);
  });
});

describe("loops", () => {
  let ours: Cellmapd;
  beforeAll(async () => {
    ours = await Cellmapd.start(viewer.town.copy("loops.db"));
  });
  afterAll(() => ours?.stop());

  test("one is asked about by a click on it, and deleting it moves the CELLs that it held", async () => {
    const { page } = viewer;
    const { cells } = await ours.json<{ cells: { id: number; pose: number[] }[] }>("/v1/maps/town/cells");
    const [first, last] = [cells[0]!, cells.at(-1)!];
    const offset = [last.pose[0]! - first.pose[0]!, last.pose[1]! - first.pose[1]! + 4, last.pose[2]! - first.pose[2]!];
    const { loops } = await ours.json<{ loops: { id: number }[] }>("/v1/maps/town/loops", {
      method: "POST",
      body: JSON.stringify({ from: first.id, to: last.id, pose: [...offset, 0, 0, 0, 1] }),
    });
    await ours.json(`/v1/maps/town/loops/${loops[0]!.id}`, { method: "PATCH", body: JSON.stringify({ pinned: true }) });
    await viewer.openMap("#/town?tab=graph", { url: ours.url });
    const now = await ours.json<{ cells: { id: number; pose: number[] }[] }>("/v1/maps/town/cells");
    await clickBetween(page, now.cells[0]!.pose, now.cells.at(-1)!.pose);
    await page.getByRole("heading", { name: /Loop \d+: pinned/ }).waitFor();
    // The address leads back to it.
    await page.goto(page.url());
    await page.reload();
    await page.getByRole("heading", { name: /Loop \d+: pinned/ }).waitFor();
    await page.getByRole("button", { name: new RegExp(`CELL ${first.id} - CELL ${last.id}`), pressed: true }).waitFor();
    await loaded(page);
    const held = await picture(page);
    await screenshot(page, "09-loop");
    await page.getByRole("button", { name: "Delete loop" }).click();
    await page.locator(".box.good", { hasText: /is gone; \d+ CELLs moved/ }).waitFor();
    await page.getByText("0 loops").waitFor();
    await page.waitForTimeout(1500);
    expect((await picture(page)).name).not.toBe(held.name);
    await screenshot(page, "10-loop-deleted");
    expect(viewer.complaints()).toEqual([]);
  });
});

describe("the past and files", () => {
  test("a slider shows the map as it was", async () => {
    const { page } = viewer;
    await viewer.openMap();
    const now = await picture(page);
    const all = await cellsInSight(page);
    await page.getByLabel("Revision that is shown").fill("3");
    await page.getByText("as it was at revision 3").waitFor();
    await loaded(page);
    expect((await picture(page)).name).not.toBe(now.name);
    await screenshot(page, "16-revision");
    const then = await cellsInSight(page);
    expect(then).toBeLessThan(all);
    expect(new URL(page.url()).hash).toContain("revision=3");
    await page.reload();
    await loaded(page);
    await page.getByText("as it was at revision 3").waitFor();
    expect(await page.getByLabel("Revision that is shown").inputValue()).toBe("3");
    await expect.poll(() => cellsInSight(page)).toBe(then);
    expect(viewer.complaints()).toEqual([]);
  });

  test("an archive opens by drop, without asking the server", async () => {
    const { page } = viewer;
    const file = viewer.town.archive();
    const asked: string[] = [];
    page.on("request", (request) => asked.push(new URL(request.url()).pathname));
    await page.goto(`${viewer.server.url}/?budget=6000`);
    await page.getByRole("link", { name: /town/ }).waitFor();
    asked.length = 0;
    await page.locator('input[type="file"]').setInputFiles(file);
    await loaded(page);
    expect((await picture(page)).colours).toBeGreaterThan(50);
    expect(asked.filter((path) => path.startsWith("/v1"))).toEqual([]);
    await screenshot(page, "17-archive");
    expect(viewer.complaints()).toEqual([]);
  });

  test("an archive opens from a plain web server by ranges", async () => {
    const content = readFileSync(viewer.town.archive());
    let ranges = 0;
    const plain = createServer((request, response) => {
      const range = /bytes=(\d+)-(\d+)/.exec(request.headers.range ?? "");
      if (request.url !== "/town.cellmap") return void servePage(request.url!, response);
      const [from, to] = [Number(range![1]), Math.min(Number(range![2]), content.length - 1)];
      ++ranges;
      response.writeHead(206, { "Content-Range": `bytes ${from}-${to}/${content.length}`, ETag: '"1"' });
      response.end(content.subarray(from, to + 1));
    }).listen(0, "127.0.0.1");
    await new Promise((resolve) => plain.once("listening", resolve));
    const url = `http://127.0.0.1:${(plain.address() as AddressInfo).port}`;
    await viewer.openMap(`#/${encodeURIComponent(`archive:${url}/town.cellmap`)}`, { url });
    const cells = (await viewer.server.json<{ cells: unknown[] }>("/v1/maps/town/cells")).cells.length;
    expect(ranges).toBeLessThanOrEqual(cells + 4);
    expect(viewer.complaints()).toEqual([]);
    plain.close();
  });

  test("a file that is no archive is refused with a reason", async () => {
    const { page } = viewer;
    await page.goto(viewer.server.url);
    await page.locator('input[type="file"]').setInputFiles({ name: "odd.cellmap", mimeType: "", buffer: Buffer.alloc(20_000) });
    await page.getByRole("alert").filter({ hasText: "no CELLmap archive" }).waitFor();
    await screenshot(page, "18-no-archive");
    expect(viewer.complaints()).toEqual([]);
  });
});

/** The built viewer as any web server has it. */
function servePage(url: string, response: ServerResponse): void {
  const path = url.split("?")[0]!;
  const file = path === "/" ? "index.html" : path.slice(1);
  const type = { js: "text/javascript", css: "text/css", svg: "image/svg+xml", html: "text/html" }[file.split(".").pop()!];
  response.writeHead(200, { "Content-Type": type ?? "application/octet-stream" });
  response.end(readFileSync(join("dist", file)));
}

describe("when something is wrong", () => {
  test("a map that is not there is said to be missing", async () => {
    const { page } = viewer;
    await page.goto(`${viewer.server.url}/#/atlantis`);
    await page.getByRole("alert").filter({ hasText: "no such map" }).waitFor();
    await screenshot(page, "11-no-such-map");
  });

  test("a server that goes away is noticed, and what was seen stays", async () => {
    const { page } = viewer;
    const ours = await Cellmapd.start(viewer.town.copy("gone.db"));
    await viewer.openMap("#/town", { url: ours.url });
    await ours.stop();
    await page.getByText("connection lost").waitFor({ timeout: 60_000 });
    expect((await picture(page)).colours).toBeGreaterThan(50);
    await page.getByRole("link", { name: /all maps/ }).click();
    await page.getByRole("alert").filter({ hasText: "does not answer" }).waitFor();
    await screenshot(page, "12-server-gone");
  });

  test("a damaged CELL is named and the others are drawn", async () => {
    const { page } = viewer;
    await page.route("**/cells:batch", async (route) => {
      const response = await route.fetch();
      const body = await response.body();
      body[8 + 500]! ^= 4;
      await route.fulfill({ response, body });
    });
    await viewer.openMap();
    await page.getByRole("alert").filter({ hasText: "cannot be shown" }).waitFor();
    expect((await picture(page)).colours).toBeGreaterThan(50);
    await screenshot(page, "13-damaged-cell");
    expect(viewer.complaints()).toEqual([]);
  });

  test("a server without maps says how to make one", async () => {
    const { page } = viewer;
    const empty = await Cellmapd.start(join(viewer.town.folder, "empty.db"));
    await page.goto(empty.url);
    await page.getByText("No maps yet").waitFor();
    await screenshot(page, "14-no-maps");
    await empty.stop();
    expect(viewer.complaints()).toEqual([]);
  });

  test("without WebGL the figures are still there", async () => {
    const plain = await Browser.open({ webgl: false });
    const flat = await plain.page();
    await flat.goto(`${viewer.server.url}/#/town`);
    await flat.getByText("no WebGL").waitFor();
    await flat.getByRole("button", { name: /monday/ }).waitFor();
    await screenshot(flat, "15-no-webgl");
    await plain.close();
  });
});
