import { expect, test } from "vitest";

import { formatRoute, parseRoute } from "../src/route";

test("a link brings back what was seen", () => {
  const route = parseRoute("#/town?tab=graph&loop=5&cell=12&colour=height&view=1,2,3,4,5.5,-6&revision=7");
  expect(route).toEqual({
    map: "town",
    tab: "graph",
    loop: 5,
    cell: 12,
    colouring: "height",
    view: { eye: [1, 2, 3], target: [4, 5.5, -6] },
    revision: 7,
  });
  expect(parseRoute(formatRoute(route))).toEqual(route);
});

test.each(["map", "graph", "drive", "locate", "jobs", "compare"])("the tab %s has a link", (tab) => {
  expect(parseRoute(formatRoute({ ...parseRoute("#/town"), tab: tab as "map" })).tab).toBe(tab);
});

test("what is not understood is left at its default", () => {
  const route = parseRoute("#/town?tab=x&loop=-1&cell=1e9&colour=<b>&view=1,2,NaN,4,5,6&revision=-3");
  expect(route).toEqual({ map: "town", tab: "map", loop: null, cell: null, colouring: "normal", view: null, revision: null });
  expect(parseRoute("").map).toBeNull();
  expect(formatRoute(parseRoute(""))).toBe("#/");
});
