// Plots as SVG, drawn by the theme's colours. All text is real text, so it can be read out and searched.

const SVG = "http://www.w3.org/2000/svg";

export function svg(tag: string, attributes: Record<string, string | number>, ...children: (SVGElement | string)[]): SVGElement {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

export interface Axis {
  label: string;
  low: number;
  high: number;
  log?: boolean;
  format: (value: number) => string;
}

/** Round values within an axis: powers of ten (and their doubles and fives where there are few), or steps of 1, 2 or 5. */
export function ticks({ low, high, log }: Pick<Axis, "low" | "high" | "log">): number[] {
  const inside = (value: number): boolean => value >= low * (1 - 1e-9) - 1e-12 && value <= high * (1 + 1e-9) + 1e-12;
  if (log) {
    const decades = Array.from({ length: Math.ceil(Math.log10(high)) - Math.floor(Math.log10(low)) + 1 }, (_, i) => 10 ** (Math.floor(Math.log10(low)) + i));
    const digits = decades.length > 4 ? [1] : [1, 2, 5];
    return decades.flatMap((decade) => digits.map((digit) => digit * decade)).filter(inside);
  }
  const power = 10 ** Math.floor(Math.log10((high - low) / 4));
  const step = power * ([1, 2, 5].find((digit) => (high - low) / (digit * power) <= 6) ?? 10);
  return Array.from({ length: Math.floor(high / step) - Math.ceil(low / step) + 1 }, (_, i) => (Math.ceil(low / step) + i) * step);
}

export interface Plot {
  element: SVGElement;
  x(value: number): number;
  y(value: number): number;
}

const MARGIN = { left: 58, right: 14, top: 10, bottom: 40 };

/** Axes with ticks and labels; what is plotted is appended to `element`. */
export function plotFrame(width: number, height: number, xAxis: Axis, yAxis: Axis, description: string): Plot {
  const place = ({ low, high, log }: Axis, from: number, to: number) => (value: number): number => {
    const t = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low || 1);
    return from + t * (to - from);
  };
  const x = place(xAxis, MARGIN.left, width - MARGIN.right);
  const y = place(yAxis, height - MARGIN.bottom, MARGIN.top);
  const element = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "figure", role: "img", "aria-label": description });
  for (const value of ticks(xAxis)) {
    element.append(
      svg("line", { class: "grid", x1: x(value), x2: x(value), y1: MARGIN.top, y2: height - MARGIN.bottom }),
      svg("text", { x: x(value), y: height - MARGIN.bottom + 16, "text-anchor": "middle" }, xAxis.format(value)),
    );
  }
  for (const value of ticks(yAxis)) {
    element.append(
      svg("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: y(value), y2: y(value) }),
      svg("text", { x: MARGIN.left - 6, y: y(value) + 4, "text-anchor": "end" }, yAxis.format(value)),
    );
  }
  const middle = (MARGIN.top + height - MARGIN.bottom) / 2;
  element.append(
    svg("text", { class: "name", x: (MARGIN.left + width - MARGIN.right) / 2, y: height - 6, "text-anchor": "middle" }, xAxis.label),
    svg("text", { class: "name", x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})` }, yAxis.label),
  );
  return { element, x, y };
}

/** A line through points, thinned to about two a pixel. */
export function line(plot: Plot, points: { x: number; y: number }[], kind: string): SVGElement {
  const step = Math.max(1, Math.floor(points.length / 1500));
  const kept = points.filter((_, i) => i % step === 0 || i === points.length - 1);
  return svg("polyline", { class: kind, points: kept.map(({ x, y }) => `${plot.x(x).toFixed(1)},${plot.y(y).toFixed(1)}`).join(" ") });
}
