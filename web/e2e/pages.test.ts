import { readFileSync } from "node:fs";
import { join } from "node:path";
import type { Page } from "playwright-core";
import { describe, expect, test } from "vitest";

import { loaded, picture, screenshot } from "./browser";
import { Cellmapd } from "./cellmapd";
import { useFixture } from "./fixture";

const viewer = useFixture({ secondDay: true });

describe("trajectories", () => {
  test("a drive is plotted before and after, and against the truth", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?tab=drive");
    const sheet = page.getByRole("region", { name: "Trajectories" });
    await sheet.getByText(/Correction along the way/).waitFor();
    expect(await sheet.locator("polyline.drive").count()).toBe(3);
    await page.locator('input[type="file"][accept*=".tum"]').setInputFiles(join(viewer.town.folder, "drive/poses_gt.txt"));
    const heading = sheet.getByText(/Error along the way: rms .* before, .* after/);
    await heading.waitFor();
    const [before, after] = (await heading.textContent())!.match(/([\d.]+) (?=cm|m\b)/g)!.map(parseFloat);
    expect(before).toBeGreaterThan(0);
    expect(after).toBeGreaterThan(0);
    expect(await sheet.locator("polyline.drive").count()).toBe(5);
    await screenshot(page, "20-trajectory");
    expect(viewer.complaints()).toEqual([]);
  });

  test("a file that is no trajectory is refused with a reason", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?tab=drive");
    await page.locator('input[type="file"][accept*=".tum"]').setInputFiles({ name: "x.txt", mimeType: "text/plain", buffer: Buffer.from("1 2 3") });
    await page.getByText(/Expected a trajectory/).waitFor();
    expect(viewer.complaints()).toEqual([]);
  });
});

describe("comparison", () => {
  test("without one the page says how to make it, with one it is plotted and listed", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?tab=compare");
    await page.getByText("No comparison yet").waitFor();
    await screenshot(page, "21-no-comparison");
    await viewer.server.json("/v1/maps/town/comparison", { method: "PUT", body: JSON.stringify(comparison()) });
    await page.reload();
    const sheet = page.getByRole("region", { name: "Comparison" });
    await sheet.getByRole("img", { name: /3 kinds of map/ }).waitFor();
    expect(await sheet.locator("circle.dot").count()).toBe(3);
    expect(await sheet.getByRole("row").count()).toBe(5);
    expect(await sheet.getByRole("row", { name: /published/ }).textContent()).toContain("-");
    await screenshot(page, "22-comparison");
    // The missing one is asked for with 404, which the browser itself writes to its console.
    expect(viewer.complaints("404")).toEqual([]);
  });
});

/** Three measured rows and a published one. */
function comparison(): unknown {
  const nothing = Object.fromEntries(
    ["planes", "bytes_per_plane", "registration_origin_m", "registrations", "registrations_failed", "encode_s", "decode_s"].map((name) => [name, null]),
  );
  const row = (name: string, bytes_per_m: number | null, error_m: number | null): unknown => ({
    ...nothing, name, measured: error_m !== null, f_score: { "0.05": null, "0.1": 0.8, "0.2": null }, bytes: null, bytes_per_m,
    accuracy_m: 0.05, completeness_m: 0.07, registration_error_m: error_m, registration_turn_deg: 0.1,
  });
  return {
    dataset: "a street", scans: 40, held_back: 8, length_m: 73,
    rows: [row("raw points", 640_000, 0.027), row("0.4 m voxels", 12_500, 0.045), row("CELLs, compact, 20 mm", 1560, 0.035), row("neural points (PIN-SLAM)", 27_000, null)],
  };
}

describe("time", () => {
  test("the map plays from its beginning to now", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town");
    await page.getByRole("button", { name: "Play" }).click();
    await page.getByText(/as it was at revision \d/).waitFor();
    await screenshot(page, "23-playing");
    await page.getByRole("button", { name: "Play" }).waitFor({ timeout: 120_000 });
    await page.getByText("The map as it is.").waitFor();
    expect(viewer.complaints()).toEqual([]);
  });

  test("CELLs are coloured by their age, and patches by what changed between two drives", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town?colour=age");
    const age = await picture(page);
    expect(age.colours).toBeGreaterThan(50);
    await screenshot(page, "24-age");
    await page.getByRole("button", { name: "Show what changed" }).click();
    await page.getByText(/places? changed, in \d+ pairs? of CELLs/).waitFor({ timeout: 60_000 });
    expect(await page.getByRole("radio", { name: "change" }).isChecked()).toBe(true);
    expect(new URL(page.url()).hash).toContain("colour=change");
    expect((await picture(page)).name).not.toBe(age.name);
    await page.getByRole("button", { name: /vanished at|appeared at/ }).first().click();
    await loaded(page);
    await screenshot(page, "25-change");
    expect(viewer.complaints()).toEqual([]);
  });
});

describe("thin links", () => {
  test("CELLs travel coded, far ones as their coarse layer, and the picture is there all the same", async () => {
    const { page } = viewer;
    let [raw, coarse, bytes] = [0, 0, 0];
    page.on("request", (request) => {
      if (request.url().includes("cells:batch")) ++raw;
      if (request.headers().accept?.includes("layers=coarse")) ++coarse;
    });
    page.on("response", async (response) => {
      if (/\/cells\/\d+\?hash=/.test(response.url())) bytes += Number((await response.allHeaders())["content-length"] ?? 0);
    });
    await viewer.openMap("#/town?view=0,-120,110,20,0,0", { query: "&cells=coded" });
    expect((await picture(page)).colours).toBeGreaterThan(50);
    expect(raw).toBe(0);
    expect(coarse).toBeGreaterThan(3);
    const { cells, encoded_bytes } = await viewer.server.json<{ cells: number; encoded_bytes: number }>("/v1/maps/town");
    expect(bytes).toBeLessThan((encoded_bytes / cells) * coarse * 0.1);
    await page.locator("canvas").focus();
    await viewer.openMap("#/town?view=0,-12,9,4,0,0&cell=2", { query: "&cells=coded" });
    await loaded(page);
    await screenshot(page, "26-coded");
    expect(viewer.complaints()).toEqual([]);
  });
});

describe("CELLs by their hash", () => {
  test("a page that is loaded again asks for no CELL that it had", async () => {
    const { page, town } = viewer;
    const ours = await Cellmapd.start(town.copy("again.db"));
    await viewer.openMap("#/town", { url: ours.url, query: "&cells=coded" });
    const once = await ours.cellRequests();
    expect(once).toBeGreaterThan(3);
    await page.reload();
    await loaded(page);
    expect(await ours.cellRequests()).toBe(once);
    expect((await picture(page)).colours).toBeGreaterThan(50);
    expect(viewer.complaints()).toEqual([]);
    await ours.stop();
  });

  test("a CELL that became another one is asked for anew", async () => {
    const { page, town } = viewer;
    const ours = await Cellmapd.start(town.copy("converted.db"));
    await viewer.openMap("#/town", { url: ours.url, query: "&cells=coded" });
    const asked: string[] = [];
    page.on("request", (request) => asked.push(request.url()));
    await ours.json("/v1/maps/town/convert", { method: "POST", body: JSON.stringify({ encoding: "compact", bound_m: 0.02 }) });
    const { cells } = await ours.json<{ cells: unknown[] }>("/v1/maps/town/cells");
    await expect.poll(() => asked.filter((url) => url.includes("?hash=")).length, { timeout: 60_000 }).toBeGreaterThanOrEqual(cells.length);
    await loaded(page);
    expect(await page.getByRole("alert").count()).toBe(0);
    expect(viewer.complaints("404")).toEqual([]);
    await ours.stop();
  });
});

describe("by keyboard and for ears", () => {
  test("tabs are walked by arrows, every control has a name, and the light theme has contrast", async () => {
    const { page } = viewer;
    await viewer.openMap("#/town");
    await page.getByRole("tab", { name: "Map" }).focus();
    for (const name of ["Loops", "Drives", "Where am I?", "Jobs", "Compare"]) {
      await page.keyboard.press("ArrowRight");
      expect(await page.getByRole("tab", { name }).getAttribute("aria-selected")).toBe("true");
      expect(await unnamed(page)).toEqual([]);
    }
    await page.keyboard.press("ArrowRight");
    await page.getByRole("button", { name: /theme/ }).click();
    expect(await unnamed(page)).toEqual([]);
    for (const theme of ["light", "dark"]) {
      await page.evaluate((name) => (document.documentElement.dataset.theme = name), theme);
      for (const [text, ground] of [["text", "panel"], ["soft", "panel"], ["soft", "ground"], ["accent", "panel"], ["danger", "raised"]]) {
        expect(await contrast(page, text!, ground!), `${text} on ${ground}, ${theme}`).toBeGreaterThan(4.5);
      }
    }
  });
});

/** Controls that a screen reader could not name. */
async function unnamed(page: Page): Promise<string[]> {
  return page.evaluate(() =>
    [...document.querySelectorAll<HTMLElement>("button, a[href], input, select, textarea, [role=img], [role=tabpanel], canvas")]
      .filter((element) => {
        const labels = (element as HTMLInputElement).labels;
        const by = element.getAttribute("aria-labelledby");
        const name = element.getAttribute("aria-label") ?? (by ? document.getElementById(by)?.textContent : null) ?? (labels?.length ? labels[0]!.textContent : null) ?? element.textContent;
        return !name?.trim();
      })
      .map((element) => element.outerHTML.slice(0, 120)),
  );
}

/** The contrast of two colours of the theme (WCAG 2). */
async function contrast(page: Page, text: string, ground: string): Promise<number> {
  return page.evaluate(
    ([a, b]) => {
      const luminance = (name: string): number => {
        const short = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
        const hex = short.length === 4 ? `#${[...short.slice(1)].map((digit) => digit + digit).join("")}` : short;
        const channel = (at: number): number => {
          const c = parseInt(hex.slice(at, at + 2), 16) / 255;
          return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
        };
        return 0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5);
      };
      const [high, low] = [luminance(a!), luminance(b!)].sort((x, y) => y - x);
      return (high! + 0.05) / (low! + 0.05);
    },
    [text, ground],
  );
}

test("the API reference is served at /api/, with its stylesheet, under the same policy", async () => {
  const { page } = viewer;
  await page.goto(viewer.server.url);
  await page.getByRole("link", { name: "API" }).click();
  await page.getByRole("heading", { name: /CELLmap API/ }).waitFor();
  expect(new URL(page.url()).pathname).toBe("/api/");
  await page.getByRole("link", { name: "relocalise" }).first().click();
  expect(new URL(page.url()).hash).toBe("#relocalise");
  expect(await page.evaluate(() => getComputedStyle(document.querySelector("main")!).paddingLeft)).toBe("32px");
  await page.evaluate(() => scrollTo(0, 0));
  await screenshot(page, "28-api");
  await page.goto(`${viewer.server.url}/api`);
  await page.getByRole("link", { name: "CELLmap", exact: true }).click();
  await page.getByRole("link", { name: /town/ }).waitFor();
  expect(viewer.complaints()).toEqual([]);
});

test("the page stays below 300 kB compressed", async () => {
  const { gzipSync } = await import("node:zlib");
  const { readdirSync } = await import("node:fs");
  const files = ["dist/index.html", ...readdirSync("dist/assets").filter((name) => !name.startsWith("api-")).map((name) => `dist/assets/${name}`)];
  const bytes = files.reduce((sum, file) => sum + gzipSync(readFileSync(file), { level: 9 }).length, 0);
  expect(bytes).toBeLessThan(300_000);
});
