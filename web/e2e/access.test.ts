import type { Page } from "playwright-core";
import { afterAll, beforeAll, describe, expect, test } from "vitest";

import { loaded, screenshot } from "./browser";
import { Cellmapd } from "./cellmapd";
import { useFixture } from "./fixture";

const viewer = useFixture({ secondDay: true });
let guarded: Cellmapd;
const tokens = { admin: "", reader: "", guest: "" };

beforeAll(async () => {
  const { town } = viewer;
  tokens.admin = town.token("me", "admin");
  tokens.reader = town.token("reader", "map:read");
  tokens.guest = town.token("guest", "relocalise");
  guarded = await Cellmapd.start(town.copy("guarded.db"), "--tokens", town.tokens, "--data-root", town.folder);
});
afterAll(() => guarded?.stop());

const prompt = (page: Page, heading: RegExp | string) => page.getByRole("alert", { name: "Token" }).filter({ has: page.getByRole("heading", { name: heading }) });

async function give(page: Page, token: string): Promise<void> {
  const box = page.getByRole("alert", { name: "Token" });
  await box.getByLabel("Token", { exact: true }).fill(token);
  await box.getByRole("button", { name: "Continue" }).click();
}

/** Opens the map as somebody who has this token. */
async function openAs(token: string, hash: string): Promise<Page> {
  const { page } = viewer;
  await page.goto(`${guarded.url}/healthz`);
  await page.evaluate((text) => sessionStorage.setItem("cellmap-token", text), token);
  await page.goto(`${guarded.url}/?budget=6000${hash}`);
  await loaded(page);
  return page;
}

test("a server that wants a token is given one, for this tab and no other", async () => {
  const { page } = viewer;
  await page.goto(`${guarded.url}/?budget=6000#/town`);
  await prompt(page, "This server asks who you are").waitFor();
  await screenshot(page, "27-token");
  await give(page, "wrong");
  await prompt(page, /does not take this token/).waitFor();
  await give(page, tokens.reader);
  await loaded(page);
  await page.getByText("live", { exact: true }).waitFor();
  await page.getByRole("link", { name: /all maps/ }).click();
  await page.getByRole("link", { name: /town/ }).waitFor();
  const other = await viewer.browser.page();
  await other.goto(guarded.url);
  await prompt(other, "This server asks who you are").waitFor();
  expect(await other.evaluate(() => sessionStorage.length)).toBe(0);
  await other.close();
  expect(viewer.complaints("401")).toEqual([]);
});

describe("a token that is not good for what is asked", () => {
  test("the list of maps and a map say which scope they want, and take another token", async () => {
    const { page } = viewer;
    await page.goto(guarded.url);
    await give(page, tokens.guest);
    await prompt(page, "Your token is not good for this").getByText("map:read").waitFor();
    await page.goto(`${guarded.url}/?budget=6000#/town?tab=jobs`);
    await prompt(page, "Your token is not good for this").getByText("map:read").waitFor();
    await screenshot(page, "29-forbidden");
    await give(page, tokens.reader);
    await loaded(page);
    await page.getByText("Map another drive").waitFor();
    expect(viewer.complaints("401", "403")).toEqual([]);
  });

  test("Loops: who may not write may not pin, until another token is there", async () => {
    const page = await openAs(tokens.reader, "#/town?tab=graph");
    await page.getByRole("button", { name: /^CELL \d+ - CELL \d+/ }).first().click();
    await page.getByRole("button", { name: "Pin", exact: true }).click();
    await prompt(page, "Your token is not good for this").getByText("map:write").waitFor();
    await screenshot(page, "30-forbidden-loop");
    await give(page, tokens.admin);
    await page.locator(".box.good", { hasText: "pinned" }).waitFor();
    await page.getByRole("heading", { name: /Loop \d+: pinned/ }).waitFor();
    expect(viewer.complaints("403")).toEqual([]);
  });

  test("Where am I?: a scan that may not be sent is sent with another token", async () => {
    const page = await openAs(tokens.reader, "#/town?tab=locate");
    await viewer.drop(viewer.town.scan(20), "000020.bin");
    await prompt(page, "Your token is not good for this").getByText("relocalise").waitFor();
    await give(page, tokens.admin);
    await page.getByRole("heading", { name: /Found near CELL/ }).waitFor({ timeout: 90_000 });
    expect(viewer.complaints("403")).toEqual([]);
  });

  test("Jobs: who may not write may not start one", async () => {
    const page = await openAs(tokens.reader, "#/town?tab=jobs");
    await page.getByText("Map another drive").click();
    await page.getByLabel(/Folder of the drive/).fill(`${viewer.town.folder}/drive`);
    await page.getByLabel(/Session/).fill("wednesday");
    await page.getByRole("button", { name: "Start ingest" }).click();
    await prompt(page, "Your token is not good for this").getByText("map:write").waitFor();
    await screenshot(page, "31-forbidden-job");
    await give(page, tokens.admin);
    await page.locator('.job[data-state="running"], .job[data-state="succeeded"]').waitFor();
    expect(viewer.complaints("403")).toEqual([]);
  });

  test("Jobs: who may not write may not cancel one", async () => {
    const headers = { Authorization: `Bearer ${tokens.admin}`, "Content-Type": "application/json" };
    // It waits for scans that nobody sends.
    const upload = { kind: "ingest", upload: true, session: "thursday", scans_total: 10 };
    await guarded.json("/v1/maps/town/jobs", { method: "POST", headers, body: JSON.stringify(upload) });
    const page = await openAs(tokens.reader, "#/town?tab=jobs");
    const job = page.locator(".job", { hasText: "thursday" });
    await job.getByRole("button", { name: "Cancel" }).click();
    await prompt(page, "Your token is not good for this").getByText("map:write").waitFor();
    await give(page, tokens.admin);
    await page.locator('.job[data-state="cancelled"]', { hasText: "thursday" }).waitFor();
    expect(viewer.complaints("403")).toEqual([]);
  });

  // What only reads is refused where the token was changed meanwhile: here by an answer in the server's place.
  for (const [tab, pattern, ask] of [
    ["drive", "**/trajectory?*", null],
    ["compare", "**/comparison", null],
    ["jobs", "**/town/jobs", null],
    ["map", "**/diff?*", "Show what changed"],
    ["map", "**/pose-graph?revision=*", "Play"],
    ["map", "**/cells:batch", null],
  ] as const) {
    test(`${tab}: ${ask ?? pattern} refused is said to be, and tried again`, async () => {
      const { page } = viewer;
      let isRefused = true;
      await page.route(pattern, async (route) => {
        if (!isRefused) return route.continue();
        const problem = { code: "permission-denied", detail: "This needs a token with the scope map:read." };
        await route.fulfill({ status: 403, contentType: "application/problem+json", body: JSON.stringify(problem) });
      });
      await page.goto(`${viewer.server.url}/?budget=6000#/town?tab=${tab}`);
      if (ask) await page.getByRole("button", { name: ask }).click();
      await prompt(page, "Your token is not good for this").waitFor();
      isRefused = false;
      await give(page, "another");
      await prompt(page, "Your token is not good for this").waitFor({ state: "detached" });
      await loaded(page);
      expect(viewer.complaints("403", "404")).toEqual([]);
    });
  }
});
