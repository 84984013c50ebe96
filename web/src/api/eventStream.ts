import { authorisation } from "./token";

export interface StreamedEvent {
  name: string;
  data: string;
  id: string | null;
}

const PAUSE_MS = 2000;

/** The events of a text that comes in pieces. */
export async function* readEvents(pieces: AsyncIterable<string>): AsyncGenerator<StreamedEvent> {
  let rest = "";
  let event: StreamedEvent = { name: "message", data: "", id: null };
  for await (const piece of pieces) {
    const lines = (rest + piece).split(/\r?\n/);
    rest = lines.pop()!;
    for (const line of lines) {
      if (line === "") {
        if (event.data !== "") yield event;
        event = { name: "message", data: "", id: null };
        continue;
      }
      const [, field, value] = /^([^:]*):? ?(.*)$/.exec(line)!;
      if (field === "event") event.name = value!;
      if (field === "data") event.data += event.data === "" ? value! : `\n${value}`;
      if (field === "id") event.id = value!;
    }
  }
}

async function* textOf(response: Response): AsyncGenerator<string> {
  const reader = response.body!.pipeThrough(new TextDecoderStream()).getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    yield value;
  }
}

/**
 * Follows server-sent events, and connects again where the stream ends, until the answer is called or `onEvent` says that it
 * was the last. An EventSource would do, if it could send a token.
 */
export function followEvents(url: string, onEvent: (event: StreamedEvent) => boolean, onState: (connected: boolean) => void): () => void {
  const stop = new AbortController();
  let last: string | null = null;
  const once = async (): Promise<boolean> => {
    const headers: Record<string, string> = { Accept: "text/event-stream", ...authorisation(url) };
    if (last !== null) headers["Last-Event-ID"] = last;
    const response = await fetch(url, { headers, signal: stop.signal, cache: "no-store" });
    if (!response.ok) return response.status !== 404;
    onState(true);
    for await (const event of readEvents(textOf(response))) {
      last = event.id ?? last;
      if (!onEvent(event)) return false;
    }
    return true;
  };
  const forever = async (): Promise<void> => {
    while (await once().catch(() => true)) {
      if (stop.signal.aborted) return;
      onState(false);
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      if (stop.signal.aborted) return;
    }
    stop.abort();
  };
  void forever();
  return () => stop.abort();
}
