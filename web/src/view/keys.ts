import { Vector3 } from "three";

import type { MapScene } from "../scene/mapScene";

const TURN = Math.PI / 24;

/** The canvas by keyboard: arrows move, plus and minus zoom, Q and E turn, F shows all. */
export function listenToKeys(canvas: HTMLCanvasElement, scene: MapScene): void {
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { stage } = scene;
    const { eye, target } = stage.view;
    const from = new Vector3(...target);
    const arm = new Vector3(...eye).sub(from);
    const ahead = new Vector3(-arm.x, -arm.y, 0).normalize().multiplyScalar(arm.length() / 12);
    const right = new Vector3(ahead.y, -ahead.x, 0);
    const actions: Record<string, () => void> = {
      ArrowUp: () => from.add(ahead),
      ArrowDown: () => from.sub(ahead),
      ArrowRight: () => from.add(right),
      ArrowLeft: () => from.sub(right),
      "+": () => arm.multiplyScalar(1 / 1.2),
      "=": () => arm.multiplyScalar(1 / 1.2),
      "-": () => arm.multiplyScalar(1.2),
      q: () => arm.applyAxisAngle(new Vector3(0, 0, 1), TURN),
      e: () => arm.applyAxisAngle(new Vector3(0, 0, 1), -TURN),
    };
    if (event.key === "f") stage.flyTo(scene.overview());
    else if (actions[event.key]) {
      actions[event.key]!();
      stage.setView({ eye: from.clone().add(arm).toArray(), target: from.toArray() });
    } else return;
    event.preventDefault();
  });
}
