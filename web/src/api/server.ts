import { type Changes, readChanges } from "../format/changes";
import { type PoseGraph, readPoseGraph } from "../format/poseGraph";
import type { CellSummary, Job, LoopExplanation, MapSummary, Relocalisation, Session } from "./documents";

/** What the server answered instead of what was asked for; status 0: it did not answer. */
export class ServerError extends Error {
  constructor(
    readonly status: number,
    readonly code: string,
    message: string,
  ) {
    super(message);
    this.name = "ServerError";
  }
}

async function ask(path: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(path, init);
  } catch (error) {
    if ((error as Error).name === "AbortError") throw error;
    throw new ServerError(0, "unavailable", "The server does not answer. Is cellmapd still running?");
  }
  if (response.ok) return response;
  const problem = await response.json().catch(() => ({}));
  throw new ServerError(response.status, problem.code ?? "internal", problem.detail ?? `The server answered ${response.status}.`);
}

const json = async <T>(path: string, init?: RequestInit): Promise<T> => (await ask(path, init)).json() as Promise<T>;

async function bytes(path: string, accept: string): Promise<Uint8Array> {
  return new Uint8Array(await (await ask(path, { headers: { Accept: accept } })).arrayBuffer());
}

const body = (method: string, value: unknown): RequestInit => ({
  method,
  headers: { "Content-Type": "application/json" },
  body: JSON.stringify(value),
});

export async function listMaps(): Promise<MapSummary[]> {
  return (await json<{ maps: MapSummary[] }>("v1/maps")).maps;
}

/** One map of the server that the page came from. All methods throw ServerError, those that read bytes FormatError. */
export class MapApi {
  private readonly base: string;

  constructor(readonly name: string) {
    this.base = `v1/maps/${encodeURIComponent(name)}`;
  }

  /** Where its CELLs are fetched, several in one answer. */
  get batchUrl(): string {
    return new URL(`${this.base}/cells:batch`, location.href).href;
  }

  summary(): Promise<MapSummary> {
    return json(this.base);
  }

  async sessions(): Promise<Session[]> {
    return (await json<{ sessions: Session[] }>(`${this.base}/sessions`)).sessions;
  }

  /** All CELLs with their current poses. */
  async cells(): Promise<CellSummary[]> {
    const cells: CellSummary[] = [];
    for (let cursor: string | null = ""; cursor !== null; ) {
      const next: string = cursor ? `&cursor=${encodeURIComponent(cursor)}` : "";
      const page: { cells: CellSummary[]; next_cursor: string | null } = await json(`${this.base}/cells?limit=10000${next}`);
      cells.push(...page.cells);
      cursor = page.next_cursor;
    }
    return cells;
  }

  async poseGraph(revision?: number): Promise<PoseGraph> {
    const query = revision === undefined ? "" : `?revision=${revision}`;
    return readPoseGraph(await bytes(`${this.base}/pose-graph${query}`, "application/vnd.cellmap.pose-graph"));
  }

  async changes(since: bigint): Promise<Changes> {
    return readChanges(await bytes(`${this.base}/changes?since=${since}`, "application/vnd.cellmap.changes"));
  }

  loop(id: number): Promise<LoopExplanation> {
    return json(`${this.base}/loops/${id}`);
  }

  pinLoop(id: number, pinned: boolean): Promise<LoopExplanation> {
    return json(`${this.base}/loops/${id}`, body("PATCH", { pinned }));
  }

  deleteLoop(id: number): Promise<{ moved: number; revision: number }> {
    return json(`${this.base}/loops/${id}`, { method: "DELETE" });
  }

  relocalise(content: Blob, type: string): Promise<Relocalisation> {
    return json(`${this.base}/relocalise`, { method: "POST", headers: { "Content-Type": type }, body: content });
  }

  async jobs(): Promise<Job[]> {
    return (await json<{ jobs: Job[] }>(`${this.base}/jobs`)).jobs;
  }

  startIngest(path: string, session: string): Promise<Job> {
    return json(`${this.base}/jobs`, body("POST", { kind: "ingest", path, ...(session ? { session } : {}) }));
  }

  cancelJob(id: number): Promise<Job> {
    return json(`v1/jobs/${id}`, { method: "DELETE" });
  }

  /** Calls `onRevision` for each new revision until the answer is called; `onState` says whether the stream is up. */
  follow(onRevision: (revision: bigint) => void, onState: (connected: boolean) => void): () => void {
    const source = new EventSource(`${this.base}/events`);
    source.addEventListener("open", () => onState(true));
    source.addEventListener("error", () => onState(false));
    source.addEventListener("revision", (event) => onRevision(BigInt((JSON.parse(event.data) as { revision: number }).revision)));
    source.addEventListener("end", () => onState(false));
    return () => source.close();
  }

  /** Calls `onProgress` for each state of a job until it ends or the answer is called. */
  followJob(id: number, onProgress: (job: Job) => void): () => void {
    const source = new EventSource(`v1/jobs/${id}/events`);
    const read = (event: MessageEvent<string>): void => onProgress(JSON.parse(event.data) as Job);
    source.addEventListener("progress", read);
    source.addEventListener("end", (event) => {
      source.close();
      read(event as MessageEvent<string>);
    });
    return () => source.close();
  }
}
