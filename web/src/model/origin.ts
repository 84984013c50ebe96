import type { MapSummary, Session } from "../api/documents";
import { MapApi } from "../api/server";
import { authorisation } from "../api/token";
import { Archive } from "../format/archive";
import { type ByteSource, SourceChanged } from "../format/byteSource";
import { positionOf, matrixOfPose } from "../scene/poses";
import type { CellSource } from "../scene/streamer";
import { MapModel } from "./mapModel";

/** A map as it was opened: from a server, which can be asked and followed, or from an archive, which cannot. */
export interface OpenedMap {
  api: MapApi | null;
  summary: MapSummary;
  sessions: Session[];
  model: MapModel;
  source: CellSource;
}

export async function openServerMap(name: string): Promise<OpenedMap> {
  const api = new MapApi(name);
  const [summary, sessions, cells, graph] = await Promise.all([api.summary(), api.sessions(), api.cells(), api.poseGraph()]);
  return { api, summary, sessions, model: MapModel.of(cells, graph), source: async (asked) => ({ url: api.cellsUrl, asked, headers: authorisation(api.cellsUrl) }) };
}

/** Begins anew, once, where the archive was replaced between two reads. */
export async function openArchive(source: ByteSource, again = true): Promise<OpenedMap> {
  try {
    return openedArchive(await Archive.open(source));
  } catch (error) {
    if (!(error instanceof SourceChanged) || !again) throw error;
    source.forget();
    return openArchive(source, false);
  }
}

function openedArchive(archive: Archive): OpenedMap {
  const { summary: about, cells, poseGraph } = archive;
  const model = new MapModel();
  for (const cell of cells) model.cells.set(cell.id, { ...cell, pose: matrixOfPose(Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)) });
  model.setGraph(poseGraph);
  if (archive.changes) model.apply(archive.changes);
  const positions = cells.map(({ id }) => positionOf(model.cells.get(id)!.pose).toArray());
  const extreme = (pick: (...values: number[]) => number): [number, number, number] =>
    [0, 1, 2].map((axis) => positions.reduce((best, p) => pick(best, p[axis]!), positions[0]?.[axis] ?? 0)) as [number, number, number];
  const summary: MapSummary = {
    name: about.map,
    lattice: about.lattice,
    revision: about.revision,
    created: "",
    cells: cells.length,
    planes: about.planes,
    constraints: model.constraints.size,
    encoded_bytes: about.cellBytes,
    stored_bytes: archive.storedBytes,
    scans: about.scans,
    raw_bytes: 0,
    voxel_bytes: 0,
    bounds: cells.length > 0 ? { min: extreme(Math.min), max: extreme(Math.max) } : null,
    sessions: about.sessions.map(({ name }) => name),
  };
  const sessions = about.sessions.map(({ name, robot, sensor }): Session => {
    const drive = model.drive(name);
    const sum = (pick: (cell: (typeof drive)[number]) => number): number => drive.reduce((total, cell) => total + pick(cell), 0);
    const aligned = !drive.some(({ id }) => model.unaligned.has(id));
    return { name, robot, sensor, started: null, cells: drive.length, planes: sum((c) => c.planes), encoded_bytes: sum((c) => c.bytes), aligned };
  });
  return { api: null, summary, sessions, model, source: (asked) => readRecords(archive, asked.map(({ id }) => id)) };
}

/** CELLs that cannot be read come with the reason instead of bytes. */
async function readRecords(archive: Archive, ids: number[]): ReturnType<CellSource> {
  const cells = await Promise.all(
    ids.map(async (id) => {
      try {
        return { id, bytes: await archive.cell(id) };
      } catch (error) {
        return { id, error: (error as Error).message };
      }
    }),
  );
  return { cells };
}
