import { h } from "../dom";

// What a CELLmap is, for somebody who has never seen one.

const SVG = "http://www.w3.org/2000/svg";

function svg(tag: string, attributes: Record<string, string | number>, ...children: SVGElement[]): SVGElement {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** A cut through a CELL: a sensor, rays of the lattice, and a piece of each wall that they meet. */
export function cellPicture(): SVGElement {
  const picture = svg("svg", { viewBox: "0 0 300 210", role: "img", "aria-label": "Rays from one origin, each with a small flat patch where it meets a wall or the ground" });
  // The street in the picture: ground, and walls left and right.
  const reach = (angle: number): number => {
    const [c, s] = [Math.cos(angle), Math.sin(angle)];
    const toGround = s > 0 ? 62 / s : Infinity;
    const toWall = c > 0 ? 128 / c : -122 / c;
    return Math.min(toGround, toWall);
  };
  for (let k = 0; k < 29; ++k) {
    const angle = -0.62 + (k * 2 * Math.PI) / 44;
    if (angle > Math.PI + 0.62) break;
    const range = reach(angle);
    const [x, y] = [150 + range * Math.cos(angle), 110 + range * Math.sin(angle)];
    const onGround = Math.abs(y - 172) < 0.5;
    picture.append(svg("line", { x1: 150, y1: 110, x2: x, y2: y, stroke: "#54c7a0", "stroke-opacity": 0.28 }));
    const half = Math.min(16, Math.max(4.5, range * 0.055));
    const ends = onGround ? { x1: x - half, y1: y, x2: x + half, y2: y } : { x1: x, y1: y - half, x2: x, y2: y + half };
    picture.append(svg("line", { ...ends, stroke: onGround ? "#9db4c9" : "#e8a33d", "stroke-width": 4, "stroke-linecap": "round" }));
    picture.append(svg("circle", { cx: 150 + 26 * Math.cos(angle), cy: 110 + 26 * Math.sin(angle), r: 1.7, fill: "#54c7a0" }));
  }
  picture.append(svg("circle", { cx: 150, cy: 110, r: 26, fill: "none", stroke: "#54c7a0", "stroke-opacity": 0.5 }));
  picture.append(svg("circle", { cx: 150, cy: 110, r: 4, fill: "#54c7a0" }));
  return picture;
}

export function explanation(): HTMLElement {
  return h(
    "section",
    { class: "hero" },
    h(
      "div",
      {},
      h("h1", {}, "Maps that stay small and can bend"),
      h(
        "p",
        {},
        "A laser scanner drives through a street. Every few metres its scans become a ",
        h("b", {}, "CELL"),
        ": the surroundings as seen from one point along 50,000 fixed directions, with ",
        h("b", {}, "one flat patch per direction"),
        ". No point is stored, only how far the patch is and how it is tilted.",
      ),
      h(
        "p",
        {},
        "A ",
        h("b", {}, "CELLmap"),
        " is many CELLs and the ",
        h("b", {}, "pose graph"),
        " that says where each one is. When the drive comes back to a known place (a ",
        h("b", {}, "loop"),
        ") only poses move. A CELL never changes, so whoever has it keeps it.",
      ),
    ),
    h("div", { "aria-hidden": "true" }, cellPicture() as unknown as HTMLElement),
  );
}
