import { ask, ServerError } from "../api/ask";
import { readBatch } from "../format/batch";
import { readCell } from "../format/cell";
import { readCoarseCell, readCodedCell } from "../format/codedCell";
import { Lattices } from "../format/lattice";
import { layOutPatches, type PatchLayout } from "./patchLayout";

// Fetches and decodes CELLs beside the page's own thread.

/** How a CELL travels: with all its bits, within 2 cm in a twentieth of the bytes, or a quarter of the planes of that. */
export type CellForm = "raw" | "compact" | "coarse";

/** A CELL that is wanted: under this number, with this content. */
export interface AskedCell {
  id: number;
  hash: string;
  form: CellForm;
}

export interface DecodeRequest {
  ticket: number;
  /** Either where a server has CELLs, and which, or bytes that are there. */
  url?: string;
  asked?: AskedCell[];
  headers?: Record<string, string>;
  cells?: Entry[];
}

interface Entry {
  id: number;
  bytes?: Uint8Array | undefined;
  error?: string;
  /** Of a raw one: what it has to be. */
  hash?: string;
  /** Of a coarse one: bytes of the whole. */
  fileBytes?: number | undefined;
}

export interface DecodeAnswer {
  ticket: number;
  cells: { id: number; patches?: PatchLayout; error?: string }[];
  bytes: number;
  /** Why nothing could be fetched: a ServerError's fields. */
  failure?: { status: number; code: string; message: string };
}

const CODED = "application/vnd.cellmap.coded-cell;encoding=compact;bound=0.02";

const lattices = new Lattices();

const bytesOf = async (response: Response): Promise<Uint8Array> => new Uint8Array(await response.arrayBuffer());

/** Near the server the browser's cache costs more than it saves: several at once, and no cache. */
async function fetchBatch({ url, headers }: DecodeRequest, asked: AskedCell[]): Promise<Entry[]> {
  if (asked.length === 0) return [];
  const body = JSON.stringify({ ids: asked.map(({ id }) => id), limit: 256 });
  const response = await ask(`${url}:batch`, { method: "POST", headers: { ...headers, "Content-Type": "application/json" }, body });
  const found = new Map(readBatch(await bytesOf(response)).map(({ cell, bytes }) => [cell, bytes]));
  return asked.map(({ id, hash }) => ({ id, hash, bytes: found.get(id), error: "The server did not send this CELL." }));
}

/**
 * By number and hash, so that the browser keeps it for ever. A CELL that is not there by this hash is one entry's error; a
 * server that gives none is everyone's.
 */
async function fetchCoded({ url, headers }: DecodeRequest, { id, hash, form }: AskedCell): Promise<Entry> {
  const isCoarse = form === "coarse";
  try {
    const response = await ask(`${url}/${id}?hash=${hash}`, { headers: { ...headers, Accept: isCoarse ? `${CODED};layers=coarse` : CODED } });
    const fileBytes = isCoarse ? Number(response.headers.get("CELLmap-File-Bytes")) : undefined;
    return { id, fileBytes, bytes: await bytesOf(response) };
  } catch (error) {
    if (error instanceof ServerError && error.status === 404) return { id, error: error.message };
    throw error;
  }
}

async function fetchCells(request: DecodeRequest): Promise<Entry[]> {
  const asked = request.asked!;
  const coded = asked.filter(({ form }) => form !== "raw").map((one) => fetchCoded(request, one));
  return [...(await fetchBatch(request, asked.filter(({ form }) => form === "raw"))), ...(await Promise.all(coded))];
}

const isCoded = (bytes: Uint8Array): boolean => String.fromCharCode(...bytes.subarray(4, 8)) === "CCOD";

async function decode({ id, bytes, hash, fileBytes }: Entry): Promise<DecodeAnswer["cells"][number]> {
  try {
    const coarse = fileBytes !== undefined;
    const cell = await (coarse ? readCoarseCell(bytes!, fileBytes, lattices) : (isCoded(bytes!) ? readCodedCell : readCell)(bytes!, lattices));
    if (hash !== undefined && cell.hash !== hash) return { id, error: "It became another one by now." };
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
    const { status = 0, code = "internal", message } = error as Partial<ServerError>;
    return { ticket, cells: [], bytes: 0, failure: { status, code, message: message ?? String(error) } };
  }
}

self.addEventListener("message", async (event: MessageEvent<DecodeRequest>) => {
  const result = await answer(event.data);
  const buffers = result.cells.flatMap(({ patches }) => (patches ? [patches.centers.buffer, patches.normals.buffer, patches.indices.buffer] : []));
  postMessage(result, { transfer: buffers as ArrayBuffer[] });
});
