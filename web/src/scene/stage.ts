import { Color, PerspectiveCamera, Scene, Vector3, WebGLRenderer } from "three";
import { MapControls } from "three/addons/controls/MapControls.js";

/** Where the camera is and what it looks at, map frame. */
export interface View {
  eye: [number, number, number];
  target: [number, number, number];
}

const LAZY_MS = 400;

export class NoWebGlError extends Error {}

function makeRenderer(canvas: HTMLCanvasElement): WebGLRenderer {
  try {
    return new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
  } catch {
    throw new NoWebGlError("This browser has no WebGL 2, which the 3D view needs. Lists and figures work without it.");
  }
}

/**
 * The canvas: camera, controls, and frames that are drawn when something changed and not otherwise.
 * Left drag moves along the ground, right drag (or Ctrl) turns, the wheel zooms to the pointer.
 */
export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(50, 1, 0.1, 20_000);
  readonly controls: MapControls;
  readonly renderer: WebGLRenderer;
  /** True where no graphics processor draws: a frame then costs by the patch. */
  readonly drawsInSoftware: boolean;
  /** Of the last frames while the camera moved; what one frame costs. */
  frameMs = 0;
  private readonly perFrame = new Set<(ms: number) => boolean>();
  private readonly movedListeners = new Set<() => void>();
  private lazy: ReturnType<typeof setTimeout> | undefined;
  private scheduled = false;
  private last = 0;

  constructor(readonly canvas: HTMLCanvasElement) {
    this.renderer = makeRenderer(canvas);
    this.drawsInSoftware = this.findSoftware();
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(0, -60, 60);
    this.controls = new MapControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.zoomToCursor = true;
    this.controls.maxPolarAngle = Math.PI * 0.495;
    this.controls.minDistance = 1;
    this.controls.maxDistance = 8000;
    this.controls.addEventListener("change", () => this.moved());
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement!);
    this.resize();
  }

  private findSoftware(): boolean {
    const gl = this.renderer.getContext();
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    const name = info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
    return /swiftshader|llvmpipe|software/i.test(name);
  }

  get view(): View {
    return { eye: this.camera.position.toArray(), target: this.controls.target.toArray() };
  }

  setView({ eye, target }: View): void {
    this.camera.position.fromArray(eye);
    this.controls.target.fromArray(target);
    this.controls.update();
    this.moved();
  }

  /** Moves there in a third of a second, or at once where the user wants less motion. */
  flyTo(to: View): void {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches || this.drawsInSoftware) return this.setView(to);
    const eye = this.camera.position.clone();
    const target = this.controls.target.clone();
    const [toEye, toTarget] = [new Vector3(...to.eye), new Vector3(...to.target)];
    this.animate(350, (t) => {
      this.camera.position.lerpVectors(eye, toEye, t);
      this.controls.target.lerpVectors(target, toTarget, t);
      this.controls.update();
      this.moved();
    });
  }

  /** Calls `step` with 0 to 1, eased, over so many milliseconds. */
  animate(ms: number, step: (t: number) => void): void {
    const start = performance.now();
    const tick = (now: number): boolean => {
      const t = Math.min(1, (now - start) / ms);
      step(t * t * (3 - 2 * t));
      return t < 1;
    };
    this.perFrame.add(tick);
    this.requestFrame();
  }

  onMoved(listener: () => void): void {
    this.movedListeners.add(listener);
  }

  setBackground(color: string): void {
    this.scene.background = new Color(color);
    this.requestFrame();
  }

  /** A frame for what arrived meanwhile: where drawing costs processor time, that goes to decoding first. */
  requestLazyFrame(): void {
    if (!this.drawsInSoftware) return this.requestFrame();
    this.lazy ??= setTimeout(() => {
      this.lazy = undefined;
      this.requestFrame();
    }, LAZY_MS);
  }

  requestFrame(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  /** Metres across one pixel at the target. */
  metresPerPixel(): number {
    const distance = this.camera.position.distanceTo(this.controls.target);
    return (2 * distance * Math.tan((this.camera.fov * Math.PI) / 360)) / this.canvas.clientHeight;
  }

  /** Where a point of the map is on the canvas, in CSS pixels; null behind the camera. */
  project(point: Vector3): { x: number; y: number } | null {
    const p = point.clone().project(this.camera);
    if (p.z > 1 || p.z < -1) return null;
    return { x: ((p.x + 1) / 2) * this.canvas.clientWidth, y: ((1 - p.y) / 2) * this.canvas.clientHeight };
  }

  dispose(): void {
    this.controls.dispose();
    this.renderer.dispose();
  }

  private moved(): void {
    for (const listener of this.movedListeners) listener();
    this.requestFrame();
  }

  private frame(now: number): void {
    this.scheduled = false;
    for (const tick of this.perFrame) if (!tick(now)) this.perFrame.delete(tick);
    this.renderer.render(this.scene, this.camera);
    // Only frames that follow one another say what a frame costs.
    const ms = now - this.last;
    if (ms < 1000) this.frameMs = this.frameMs === 0 ? ms : 0.8 * this.frameMs + 0.2 * ms;
    this.last = now;
    if (this.perFrame.size > 0) this.requestFrame();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement!;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / Math.max(1, height);
    this.camera.updateProjectionMatrix();
    this.moved();
  }
}
