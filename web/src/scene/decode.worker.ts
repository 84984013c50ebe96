import { readBatch } from "../format/batch";
import { readCell } from "../format/cell";
import { readCoarseCell, readCodedCell } from "../format/codedCell";
import { Lattices } from "../format/lattice";
import { layOutPatches, type PatchLayout } from "./patchLayout";

// Fetches and decodes CELLs beside the page's own thread.

/** How a CELL travels: with all its bits, within 2 cm in a twentieth of the bytes, or a quarter of the planes of that. */
export type CellForm = "raw" | "compact" | "coarse";

export interface DecodeRequest {
  ticket: number;
  /** Either where a server has CELLs, and which, or bytes that are there. */
  url?: string;
  asked?: { id: number; form: CellForm }[];
  headers?: Record<string, string>;
  cells?: Entry[];
}

interface Entry {
  id: number;
  bytes?: Uint8Array;
  error?: string;
  /** Of a coarse one: bytes of the whole. */
  fileBytes?: number;
}

export interface DecodeAnswer {
  ticket: number;
  cells: { id: number; patches?: PatchLayout; error?: string }[];
  bytes: number;
  /** Why nothing could be fetched. */
  error?: string;
}

const lattices = new Lattices();

async function ask(url: string, init: RequestInit): Promise<Response> {
  const response = await fetch(url, init);
  if (!response.ok) throw new Error(`The server answered ${response.status} to a request for CELLs.`);
  return response;
}

const bytesOf = async (response: Response): Promise<Uint8Array> => new Uint8Array(await response.arrayBuffer());

async function fetchBatch({ url, headers }: DecodeRequest, ids: number[]): Promise<Entry[]> {
  if (ids.length === 0) return [];
  const init = { method: "POST", headers: { ...headers, "Content-Type": "application/json" }, body: JSON.stringify({ ids, limit: 256 }) };
  return readBatch(await bytesOf(await ask(`${url}:batch`, init))).map(({ cell, bytes }) => ({ id: cell, bytes }));
}

/** By its own address, so that the browser keeps it: a CELL never changes. */
async function fetchCoded({ url, headers }: DecodeRequest, id: number, coarse: boolean): Promise<Entry> {
  const accept = `application/vnd.cellmap.coded-cell;encoding=compact;bound=0.02${coarse ? ";layers=coarse" : ""}`;
  const response = await ask(`${url}/${id}`, { headers: { ...headers, Accept: accept } });
  const whole = Number(response.headers.get("CELLmap-File-Bytes"));
  return { id, bytes: await bytesOf(response), ...(coarse ? { fileBytes: whole } : {}) };
}

async function fetchCells(request: DecodeRequest): Promise<Entry[]> {
  const asked = request.asked!;
  const raw = asked.filter(({ form }) => form === "raw").map(({ id }) => id);
  const coded = asked.filter(({ form }) => form !== "raw").map(({ id, form }) => fetchCoded(request, id, form === "coarse"));
  return [...(await fetchBatch(request, raw)), ...(await Promise.all(coded))];
}

const isCoded = (bytes: Uint8Array): boolean => String.fromCharCode(...bytes.subarray(4, 8)) === "CCOD";

async function decode({ id, bytes, fileBytes }: Entry): Promise<DecodeAnswer["cells"][number]> {
  try {
    const coarse = fileBytes !== undefined;
    const cell = await (coarse ? readCoarseCell(bytes!, fileBytes, lattices) : (isCoded(bytes!) ? readCodedCell : readCell)(bytes!, lattices));
    return { id, patches: layOutPatches(cell, lattices.get(cell.lattice), coarse) };
  } catch (error) {
    return { id, error: (error as Error).message };
  }
}

async function answer(request: DecodeRequest): Promise<DecodeAnswer> {
  const { ticket } = request;
  try {
    const entries = request.cells ?? (await fetchCells(request));
    const cells: DecodeAnswer["cells"] = [];
    for (const entry of entries) cells.push(entry.bytes ? await decode(entry) : { id: entry.id, error: entry.error ?? "It is missing." });
    return { ticket, cells, bytes: entries.reduce((sum, { bytes }) => sum + (bytes?.length ?? 0), 0) };
  } catch (error) {
    return { ticket, cells: [], bytes: 0, error: (error as Error).message };
  }
}

self.addEventListener("message", async (event: MessageEvent<DecodeRequest>) => {
  const result = await answer(event.data);
  const buffers = result.cells.flatMap(({ patches }) => (patches ? [patches.centers.buffer, patches.normals.buffer, patches.indices.buffer] : []));
  postMessage(result, { transfer: buffers as ArrayBuffer[] });
});
