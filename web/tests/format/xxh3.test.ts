import { expect, test } from "vitest";

import { xxh3 } from "../../src/format/xxh3";

// By the xxHash library (XXH3_64bits) of the first bytes of (i * i + 7 * i) mod 251.
const EXPECTED: [number, bigint][] = [
  [0, 0x2d06800538d394c2n],
  [1, 0xc44bdff4074eecdbn],
  [3, 0xf4f33fa3678ce51en],
  [4, 0xe8dbf7d35c51ddeen],
  [8, 0xe45c3d81190e7604n],
  [9, 0xf4b76668596c2950n],
  [16, 0xd86a23b30cd30159n],
  [17, 0xbffe3b45969fb632n],
  [32, 0x14718ba680e23b6cn],
  [33, 0x50eebcc5191cd3e5n],
  [64, 0xe47d29dabd81cd8dn],
  [65, 0x9fcae91c17fa2ca9n],
  [96, 0x0cc076ec9f33a47fn],
  [97, 0x47472ff15d8a4b98n],
  [128, 0xf576a7fc2664a8dbn],
  [129, 0xa06d97faca7604c6n],
  [200, 0x6dc00af8f2b4b055n],
  [240, 0x312c5d76429853c8n],
  [241, 0x905dd607eda3dae7n],
  [512, 0xdd54bb86e4d619b2n],
  [1023, 0xe7e2567891a48ed1n],
  [1024, 0xdd4fac0ebefc3cc1n],
  [1025, 0xd065a708d7cab970n],
  [2048, 0xd1df33d87f374ac1n],
  [2049, 0xd0e4c077d1c420a8n],
  [5000, 0x6cce044fb9d3e753n],
];

const input = Uint8Array.from({ length: 5000 }, (_, i) => (i * i + 7 * i) % 251);

test.each(EXPECTED)("the sum of %i bytes is that of the xxHash library", (length, sum) => {
  expect(xxh3(input.subarray(0, length))).toBe(sum);
});
