import { readFileSync } from "node:fs";
import type { Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, beforeEach } from "vitest";

import { Browser, loaded } from "./browser";
import { Cellmapd, Town } from "./cellmapd";

/** What the tests of a file share: a town, a server of it, a browser; and a page for each test. */
export class Fixture {
  town!: Town;
  server!: Cellmapd;
  browser!: Browser;
  page!: Page;

  /** Opens the map with few enough patches for drawing in software. */
  async openMap(hash = "#/town", { url = this.server.url, query = "" } = {}): Promise<void> {
    await this.page.goto(`${url}/?budget=6000${query}${hash}`);
    await loaded(this.page);
  }

  /** What the page wrote to the console that it should not have; `but` are words of what it may. */
  complaints(...but: string[]): string[] {
    return this.browser.complaints.filter((text) => !but.some((words) => text.includes(words)));
  }

  /** Drops a file of this computer on the map. */
  async drop(file: string, name: string): Promise<void> {
    const content = readFileSync(file).toString("base64");
    const transfer = await this.page.evaluateHandle(
      ({ content, name }) => {
        const bytes = Uint8Array.from(atob(content), (c) => c.charCodeAt(0));
        const data = new DataTransfer();
        data.items.add(new File([bytes], name));
        return data;
      },
      { content, name },
    );
    await this.page.dispatchEvent(".stage", "dragover", { dataTransfer: transfer });
    await this.page.dispatchEvent(".stage", "drop", { dataTransfer: transfer });
  }
}

/** Of this file's tests. `secondDay`: the map has a session of another day. `dataRoot`: the server may read the town's drives. */
export function useFixture({ secondDay = false, dataRoot = false } = {}): Fixture {
  const fixture = new Fixture();
  beforeAll(async () => {
    fixture.town = new Town();
    if (secondDay) fixture.town.secondDay();
    fixture.server = await Cellmapd.start(fixture.town.store, ...(dataRoot ? ["--data-root", fixture.town.folder] : []));
    fixture.browser = await Browser.open();
  });
  afterAll(async () => {
    await fixture.browser?.close();
    await fixture.server?.stop();
    fixture.town?.remove();
  });
  beforeEach(async () => {
    fixture.browser.complaints.length = 0;
    fixture.page = await fixture.browser.page();
  });
  afterEach(() => fixture.page.close());
  return fixture;
}
