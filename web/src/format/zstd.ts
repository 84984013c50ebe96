import { decompress } from "fzstd";

import { corrupt, tooLarge } from "./error";

// FORMAT.md, "Compression": exactly one frame that declares its size. fzstd decodes; what it takes more lightly than
// the format does is checked here, before anything is allocated.

interface Frame {
  contentSize: number;
  end: number;
}

function readFrame(bytes: Uint8Array): Frame {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  try {
    if (view.getUint32(0, true) !== 0xfd2fb528) corrupt("Expected a zstd frame, found other bytes.");
    const descriptor = view.getUint8(4);
    const singleSegment = (descriptor & 32) !== 0;
    if ((descriptor & 8) !== 0) corrupt("The zstd frame has a reserved bit set.");
    if ((descriptor & 3) !== 0) corrupt("The zstd frame needs a dictionary.");
    let at = singleSegment ? 5 : 6;
    const sizeFlag = descriptor >> 6;
    if (sizeFlag === 0 && !singleSegment) corrupt("The zstd frame does not declare its size.");
    const contentSize = [
      () => view.getUint8(at),
      () => view.getUint16(at, true) + 256,
      () => view.getUint32(at, true),
      () => Number(view.getBigUint64(at, true)),
    ][sizeFlag]!();
    at += [1, 2, 4, 8][sizeFlag]!;
    for (let last = false; !last; ) {
      const header = view.getUint16(at, true) + (view.getUint8(at + 2) << 16);
      last = (header & 1) !== 0;
      const type = (header >> 1) & 3;
      at += 3 + (type === 1 ? 1 : header >> 3);
      if (type === 3) corrupt("The zstd frame has a block of reserved type.");
    }
    at += (descriptor & 4) !== 0 ? 4 : 0;
    return { contentSize, end: at };
  } catch (error) {
    if (error instanceof RangeError) corrupt("The zstd frame is cut.");
    throw error;
  }
}

/** The content of the one frame that `bytes` are, at most `maxBytes` long. Throws FormatError. */
export function zstdDecompress(bytes: Uint8Array, maxBytes: number): Uint8Array {
  const frame = readFrame(bytes);
  if (frame.contentSize > maxBytes) tooLarge(`The zstd frame holds ${frame.contentSize} bytes; at most ${maxBytes} are read.`);
  if (frame.end !== bytes.length) corrupt(`Expected one zstd frame of ${frame.end} bytes, found ${bytes.length} bytes.`);
  let content: Uint8Array;
  try {
    content = decompress(bytes);
  } catch (error) {
    corrupt(`The zstd frame is damaged (${(error as Error).message}).`);
  }
  if (content.length !== frame.contentSize) {
    corrupt(`The zstd frame declares ${frame.contentSize} bytes and holds ${content.length}.`);
  }
  return content;
}
