import { readBatch } from "../format/batch";
import { readCell } from "../format/cell";
import { Lattices } from "../format/lattice";
import { layOutPatches, type PatchLayout } from "./patchLayout";

// Fetches and decodes CELLs beside the page's own thread.

export interface DecodeRequest {
  ticket: number;
  /** Either a server's batch address and ids, or bytes that are there. */
  url?: string;
  ids?: number[];
  cells?: { id: number; bytes: Uint8Array }[];
}

export interface DecodeAnswer {
  ticket: number;
  cells: { id: number; patches?: PatchLayout; error?: string }[];
  bytes: number;
  /** Why nothing could be fetched. */
  error?: string;
}

const lattices = new Lattices();

async function fetchBatch(url: string, ids: number[]): Promise<Uint8Array> {
  const response = await fetch(url, {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ ids, limit: 256 }),
  });
  if (!response.ok) throw new Error(`The server answered ${response.status} to a request for CELLs.`);
  return new Uint8Array(await response.arrayBuffer());
}

async function decode(id: number, bytes: Uint8Array): Promise<DecodeAnswer["cells"][number]> {
  try {
    const cell = await readCell(bytes, lattices);
    return { id, patches: layOutPatches(cell, lattices.get(cell.lattice)) };
  } catch (error) {
    return { id, error: (error as Error).message };
  }
}

async function answer(request: DecodeRequest): Promise<DecodeAnswer> {
  const { ticket } = request;
  try {
    const batch = request.url ? await fetchBatch(request.url, request.ids!) : new Uint8Array();
    const entries = request.cells ?? readBatch(batch).map(({ cell, bytes }) => ({ id: cell, bytes }));
    const cells: DecodeAnswer["cells"] = [];
    for (const { id, bytes } of entries) cells.push(await decode(id, bytes));
    return { ticket, cells, bytes: batch.length };
  } catch (error) {
    return { ticket, cells: [], bytes: 0, error: (error as Error).message };
  }
}

self.addEventListener("message", async (event: MessageEvent<DecodeRequest>) => {
  const result = await answer(event.data);
  const buffers = result.cells.flatMap(({ patches }) => (patches ? [patches.centers.buffer, patches.normals.buffer] : []));
  postMessage(result, { transfer: buffers as ArrayBuffer[] });
});
