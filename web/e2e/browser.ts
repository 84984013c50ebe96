import { mkdirSync, mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { type BrowserContext, chromium, type Page } from "playwright-core";

const FLAGS = [
  "--headless",
  "--no-sandbox",
  "--disable-gpu",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
];

/** Chromium with a profile of its own; what its pages complain of is kept. */
export class Browser {
  readonly complaints: string[] = [];

  private constructor(
    private readonly context: BrowserContext,
    private readonly profile: string,
  ) {}

  static async open(options: { webgl?: boolean } = {}): Promise<Browser> {
    const profile = mkdtempSync(join(tmpdir(), "cellmap-chromium-"));
    const drawing = options.webgl === false ? ["--disable-3d-apis"] : ["--enable-unsafe-swiftshader"];
    const context = await chromium.launchPersistentContext(profile, {
      executablePath: "/usr/bin/chromium",
      headless: true,
      args: [...FLAGS, ...drawing],
      viewport: { width: 1080, height: 680 },
      colorScheme: "dark",
    });
    return new Browser(context, profile);
  }

  async page(): Promise<Page> {
    const page = await this.context.newPage();
    page.setDefaultTimeout(60_000);
    page.on("pageerror", (error) => this.complaints.push(String(error)));
    page.on("console", (message) => {
      if (message.type() === "error") this.complaints.push(message.text());
    });
    return page;
  }

  /** The browser's processes, by their kind. */
  async processes(): Promise<{ id: number; type: string; cpuTime: number }[]> {
    const session = await this.context.browser()!.newBrowserCDPSession();
    return (await session.send("SystemInfo.getProcessInfo")).processInfo;
  }

  async close(): Promise<void> {
    await this.context.close();
    rmSync(this.profile, { recursive: true, force: true });
  }
}

/** What tests see of the scene that the page puts on `window`. */
interface Point {
  clone(): { set(x: number, y: number, z: number): unknown };
}
interface SceneOnWindow {
  cellmapScene: {
    figures(): { patches: number; loaded: number; wanted: number };
    stage: {
      renderer: { render(a: unknown, b: unknown): void; getContext(): WebGL2RenderingContext };
      scene: unknown;
      camera: { position: Point };
      project(point: unknown): { x: number; y: number } | null;
    };
  };
}

/** Waits until all CELLs in sight are there. */
export async function loaded(page: Page): Promise<void> {
  await page.waitForFunction(
    () => {
      const scene = (window as unknown as SceneOnWindow).cellmapScene;
      const figures = scene?.figures();
      return figures !== undefined && figures.wanted > 0 && figures.loaded === figures.wanted && figures.patches > 0;
    },
    undefined,
    { timeout: 120_000 },
  );
}

/** CELLs in sight. */
export async function cellsInSight(page: Page): Promise<number> {
  return page.evaluate(() => (window as unknown as SceneOnWindow).cellmapScene.figures().wanted);
}

/** Clicks on the picture half-way between two points of the map. */
export async function clickBetween(page: Page, from: number[], to: number[]): Promise<void> {
  const at = await page.evaluate(([a, b]) => {
    const { stage } = (window as unknown as SceneOnWindow).cellmapScene;
    const [p, q] = [a!, b!].map(([x, y, z]) => stage.project(stage.camera.position.clone().set(x!, y!, z!))!);
    return { x: (p!.x + q!.x) / 2, y: (p!.y + q!.y) / 2 };
  }, [from, to]);
  await page.locator("canvas").click({ position: at });
}

/** Every 7th pixel of the canvas, drawn anew: how many colours it has, and a number that names the picture. */
export async function picture(page: Page): Promise<{ colours: number; name: number }> {
  return page.evaluate(() => {
    const { stage } = (window as unknown as SceneOnWindow).cellmapScene;
    stage.renderer.render(stage.scene, stage.camera);
    const gl = stage.renderer.getContext();
    const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const colours = new Set<number>();
    let name = 0;
    for (let i = 0; i < pixels.length; i += 28) {
      const colour = (pixels[i]! << 16) | (pixels[i + 1]! << 8) | pixels[i + 2]!;
      colours.add(colour);
      name = (name * 31 + colour) | 0;
    }
    return { colours: colours.size, name };
  });
}

/** Beside the test results: screenshots/NAME.png. */
export async function screenshot(page: Page, name: string): Promise<void> {
  mkdirSync("screenshots", { recursive: true });
  await page.screenshot({ path: `screenshots/${name}.png` });
}
