import { ask, ServerError } from "../api/ask";
import { readCell } from "../format/cell";
import { readCoarseCell, readCodedCell } from "../format/codedCell";
import { Lattices } from "../format/lattice";
import { layOutPatches, type PatchLayout } from "./patchLayout";

// Fetches and decodes CELLs beside the page's own thread.

/** How a CELL travels: with all its bits, within 2 cm in a twentieth of the bytes, or a quarter of the planes of that. */
export type CellForm = "raw" | "compact" | "coarse";

/** A CELL that is wanted; its hash makes an address whose answer the browser keeps for ever. */
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
  bytes?: Uint8Array;
  error?: string;
  /** Of a coarse one: bytes of the whole. */
  fileBytes?: number;
}

export interface DecodeAnswer {
  ticket: number;
  cells: { id: number; patches?: PatchLayout; error?: string }[];
  bytes: number;
  /** Why nothing could be fetched: a ServerError's fields. */
  failure?: { status: number; code: string; message: string };
}

const CODED = "application/vnd.cellmap.coded-cell;encoding=compact;bound=0.02";
const ACCEPT: Record<CellForm, string> = { raw: "application/vnd.cellmap.cell", compact: CODED, coarse: `${CODED};layers=coarse` };

const lattices = new Lattices();

/** A CELL that is not there by this hash is one entry's error; a server that gives none is everyone's. */
async function fetchCell({ url, headers }: DecodeRequest, { id, hash, form }: AskedCell): Promise<Entry> {
  try {
    const response = await ask(`${url}/${id}?hash=${hash}`, { headers: { ...headers, Accept: ACCEPT[form] } });
    const bytes = new Uint8Array(await response.arrayBuffer());
    return { id, bytes, ...(form === "coarse" ? { fileBytes: Number(response.headers.get("CELLmap-File-Bytes")) } : {}) };
  } catch (error) {
    if (error instanceof ServerError && error.status === 404) return { id, error: error.message };
    throw error;
  }
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
    const entries = request.cells ?? (await Promise.all(request.asked!.map((one) => fetchCell(request, one))));
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
