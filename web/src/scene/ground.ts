import { Box3, GridHelper, LineBasicMaterial, type Object3D } from "three";

/** The nearest 1, 2 or 5 times a power of ten at or below. */
export function roundLength(metres: number): number {
  const power = 10 ** Math.floor(Math.log10(metres));
  const digit = metres / power;
  return (digit >= 5 ? 5 : digit >= 2 ? 2 : 1) * power;
}

/** A grid under the map, lines some twentieths of its size apart, through whole multiples of that. */
export function groundGrid(bounds: Box3, colour: string): Object3D {
  const span = Math.max(40, bounds.max.x - bounds.min.x, bounds.max.y - bounds.min.y) * 1.6;
  const step = roundLength(span / 20);
  const divisions = 2 * Math.ceil(span / step / 2);
  const grid = new GridHelper(divisions * step, divisions, colour, colour);
  grid.rotation.x = Math.PI / 2;
  const snap = (x: number): number => Math.round(x / step) * step;
  // CELLs lie at the height of the sensor, about two metres above the ground.
  grid.position.set(snap((bounds.min.x + bounds.max.x) / 2), snap((bounds.min.y + bounds.max.y) / 2), bounds.min.z - 2);
  const material = grid.material as LineBasicMaterial;
  material.transparent = true;
  material.opacity = 0.35;
  material.depthWrite = false;
  return grid;
}
