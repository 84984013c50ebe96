import { authorisation } from "../api/token";
import { corrupt } from "./error";

/** Bytes that are read in pieces: a file, or a resource of any web server that answers Range requests. */
export interface ByteSource {
  readonly name: string;
  /** Its length; known after the first read. */
  readonly size: number;
  /** At most `length` bytes from `offset` on: fewer only at the end. */
  read(offset: number, length: number): Promise<Uint8Array>;
  /** The next read is a first one again. */
  forget(): void;
}

/** The resource was replaced between two reads. */
export class SourceChanged extends Error {}

export class BlobSource implements ByteSource {
  readonly size: number;

  constructor(
    private readonly blob: Blob,
    readonly name: string,
  ) {
    this.size = blob.size;
  }

  async read(offset: number, length: number): Promise<Uint8Array> {
    return new Uint8Array(await this.blob.slice(offset, offset + length).arrayBuffer());
  }

  forget(): void {}
}

/** By HTTP Range, with If-Match on every read but the first. Servers without ranges send all, once. */
export class HttpSource implements ByteSource {
  size = 0;
  private etag: string | null = null;
  private whole: Uint8Array | null = null;

  constructor(private readonly url: string) {}

  get name(): string {
    return this.url.split("/").pop()!.split("?")[0]!;
  }

  forget(): void {
    this.size = 0;
    this.etag = null;
    this.whole = null;
  }

  async read(offset: number, length: number): Promise<Uint8Array> {
    if (this.whole) return this.whole.subarray(offset, offset + length);
    const headers: Record<string, string> = { Range: `bytes=${offset}-${offset + length - 1}`, ...authorisation(this.url) };
    // A weak tag never matches If-Match (RFC 9110, 13.1.1).
    if (this.etag && !this.etag.startsWith("W/")) headers["If-Match"] = this.etag;
    const response = await fetch(this.url, { headers, cache: "no-store" }).catch(() => {
      throw new Error(`${this.url} cannot be fetched. A viewer may only ask the server that it came from.`);
    });
    if (response.status === 412) throw new SourceChanged(`${this.name} was replaced while it was read.`);
    if (!response.ok) throw new Error(`${this.url} was answered with ${response.status}.`);
    const body = new Uint8Array(await response.arrayBuffer());
    this.etag ??= response.headers.get("ETag");
    if (response.status === 200) {
      this.whole = body;
      this.size = body.length;
      return body.subarray(offset, offset + length);
    }
    const total = /\/(\d+)$/.exec(response.headers.get("Content-Range") ?? "");
    if (!total) corrupt(`${this.url} answers ranges without saying how long it is.`);
    if (this.size !== 0 && this.size !== Number(total[1])) throw new SourceChanged(`${this.name} changed its length while it was read.`);
    this.size = Number(total[1]);
    return body;
  }
}
