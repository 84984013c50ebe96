import { type Changes, readChanges } from "../format/changes";
import { type PoseGraph, readPoseGraph } from "../format/poseGraph";
import type { CellSummary, Comparison, Job, LoopExplanation, MapSummary, Relocalisation, Session, SessionDiff } from "./documents";
import { ask as askAnyone, ServerError } from "./ask";
import { followEvents } from "./eventStream";
import { authorisation } from "./token";

const ask = (path: string, init?: RequestInit): Promise<Response> => askAnyone(path, { ...init, headers: { ...init?.headers, ...authorisation(path) } });

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

  /** Below it are its CELLs, each by its number. */
  get cellsUrl(): string {
    return new URL(`${this.base}/cells`, location.href).href;
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

  /** What `cellmap compare` measured for this map; null where nobody put it. */
  async comparison(): Promise<Comparison | null> {
    try {
      return await json<Comparison>(`${this.base}/comparison`);
    } catch (error) {
      if (error instanceof ServerError && error.status === 404) return null;
      throw error;
    }
  }

  /** One line a scan: stamp and pose (TUM). */
  async trajectory(session: string, stage: "odometry" | "corrected"): Promise<string> {
    const query = new URLSearchParams({ session, stage, format: "tum" });
    return (await ask(`${this.base}/trajectory?${query}`, { headers: { Accept: "text/plain" } })).text();
  }

  diff(earlier: string, later: string): Promise<SessionDiff> {
    return json(`${this.base}/diff?sessions=${encodeURIComponent(earlier)},${encodeURIComponent(later)}&patches=true`);
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
    return followEvents(
      `${this.base}/events`,
      ({ name, data }) => {
        if (name === "revision") onRevision(BigInt((JSON.parse(data) as { revision: number }).revision));
        if (name === "end") onState(false);
        return true;
      },
      onState,
    );
  }

  /** Calls `onProgress` for each state of a job until it ends or the answer is called. */
  followJob(id: number, onProgress: (job: Job) => void): () => void {
    return followEvents(
      `v1/jobs/${id}/events`,
      ({ name, data }) => {
        onProgress(JSON.parse(data) as Job);
        return name !== "end";
      },
      () => undefined,
    );
  }
}
