import { expect, test } from "vitest";

import { readEvents, type StreamedEvent } from "../src/api/eventStream";

async function eventsOf(text: string, size: number): Promise<StreamedEvent[]> {
  async function* pieces(): AsyncGenerator<string> {
    for (let i = 0; i < text.length; i += size) yield text.slice(i, i + size);
  }
  const events: StreamedEvent[] = [];
  for await (const event of readEvents(pieces())) events.push(event);
  return events;
}

const TEXT = ": hello\n\nevent: revision\nid: 7\ndata: {\"a\": 1}\n\ndata: two\ndata:lines\n\nevent: end\r\ndata: x: y\r\n\r\nevent: cut\ndata: off";

test.each([1, 2, 3, 7, 1000])("events are the same in pieces of %i characters", async (size) => {
  expect(await eventsOf(TEXT, size)).toEqual([
    { name: "revision", data: '{"a": 1}', id: "7" },
    { name: "message", data: "two\nlines", id: null },
    { name: "end", data: "x: y", id: null },
  ]);
});
