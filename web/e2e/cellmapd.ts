import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { cpSync, mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

const cellmap = process.env.CELLMAP_PROGRAM!;
const cellmapd = process.env.CELLMAPD_PROGRAM!;

/** A small drive and the map of it, in a folder of its own. */
export class Town {
  readonly folder = mkdtempSync(join(tmpdir(), "cellmap-web-"));
  readonly store = join(this.folder, "map.db");

  constructor() {
    const drive = join(this.folder, "drive");
    const run = (...args: string[]): void => void execFileSync(cellmap, args, { stdio: "pipe" });
    run("simulate", "--route", "town", "--scans", "70", "--columns", "700", "--odometry", "drift", "--out", drive, "--json");
    run("build", drive, "--store", this.store, "--map", "town", "--session", "monday", "--lattice-size", "20000", "--json");
  }

  /** Another drive along the same street, on another day: some cars are gone, others are there. */
  secondDay(): void {
    const drive = join(this.folder, "drive-2");
    const run = (...args: string[]): void => void execFileSync(cellmap, args, { stdio: "pipe" });
    run("simulate", "--route", "town", "--scans", "70", "--columns", "700", "--odometry", "truth", "--traffic-seed", "9", "--out", drive, "--json");
    run("build", drive, "--store", this.store, "--map", "town", "--session", "tuesday", "--json");
  }

  /** The map as one file. */
  archive(): string {
    const file = join(this.folder, "town.cellmap");
    execFileSync(cellmap, ["archive", "town", "--store", this.copy("for-archive.db"), "--encoding", "compact", "--out", file], { stdio: "pipe" });
    return file;
  }

  scan(index: number): string {
    return join(this.folder, "drive/velodyne", `${String(index).padStart(6, "0")}.bin`);
  }

  /** A new token; `cellmapd --tokens` reads `tokens`. */
  token(name: string, ...scopes: string[]): string {
    return execFileSync(cellmap, ["token", "create", name, "--tokens", this.tokens, "--scope", scopes.join(",")], { encoding: "utf8" }).trim();
  }

  get tokens(): string {
    return join(this.folder, "tokens");
  }

  /** The same store with the map as it was made. */
  copy(name: string): string {
    const to = join(this.folder, name);
    cpSync(this.store, to);
    return to;
  }

  remove(): void {
    rmSync(this.folder, { recursive: true, force: true });
  }
}

/** A running cellmapd on a free port. */
export class Cellmapd {
  private constructor(
    private readonly process: ChildProcess,
    readonly url: string,
  ) {}

  static async start(store: string, ...flags: string[]): Promise<Cellmapd> {
    const child = spawn(cellmapd, ["--store", store, "--listen", "127.0.0.1:0", "--threads", "2", "--log-level", "error", "--viewer", "dist", ...flags]);
    const url = await new Promise<string>((resolve, reject) => {
      let text = "";
      child.stdout.on("data", (chunk: Buffer) => {
        text += chunk.toString();
        const found = /http:\/\/\S+/.exec(text);
        if (found) resolve(found[0]);
      });
      child.stderr.on("data", (chunk: Buffer) => (text += chunk.toString()));
      child.on("exit", () => reject(new Error(`cellmapd ended: ${text}`)));
    });
    return new Cellmapd(child, url);
  }

  /** What it used since it started. */
  processorSeconds(): number {
    const fields = readFileSync(`/proc/${this.process.pid}/stat`, "utf8").split(") ")[1]!.split(" ");
    return (Number(fields[11]) + Number(fields[12])) / 100;
  }

  async json<T>(path: string, init?: RequestInit): Promise<T> {
    const response = await fetch(this.url + path, { headers: { "Content-Type": "application/json" }, ...init });
    return (await response.json()) as T;
  }

  /** How many requests it has answered with a single CELL. */
  async cellRequests(): Promise<number> {
    const metrics = await (await fetch(`${this.url}/metrics`)).text();
    const counts = metrics.matchAll(/^http_requests_total\{[^}]*route="\/v1\/maps\/\{map\}\/cells\/\{cell\}"[^}]*\} (\d+)$/gm);
    return [...counts].reduce((sum, [, count]) => sum + Number(count), 0);
  }

  /** Lets it work a sixth of the time meanwhile, so that what it does quickly can be watched. */
  async slowly<T>(work: () => Promise<T>): Promise<T> {
    const pause = setInterval(() => {
      this.process.kill("SIGSTOP");
      setTimeout(() => this.process.kill("SIGCONT"), 250);
    }, 300);
    try {
      return await work();
    } finally {
      clearInterval(pause);
      setTimeout(() => this.process.kill("SIGCONT"), 300);
    }
  }

  async stop(): Promise<void> {
    if (this.process.exitCode !== null) return;
    const ended = new Promise((resolve) => this.process.once("exit", resolve));
    this.process.kill();
    await ended;
  }
}
