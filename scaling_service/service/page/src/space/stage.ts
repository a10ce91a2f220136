/** The stage: a floor, light, a camera that is turned by mouse, touch and keys, and drawing when something changed. */

import {
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  PerspectiveCamera,
  Scene,
  Spherical,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { inkOf } from "../charts/ink.ts";
import { h } from "../ui/dom.ts";
import { isSoftware, Pace, type Quality } from "./quality.ts";
import { onTheme, theme, type Theme } from "../ui/theme.ts";

const TURN = Math.PI / 24;
const NEARER = 0.9;
/** Chosen: so much room around what is looked at. */
const ROOM = 1.4;
const OBLIQUE = [0.62, 0.28, 0.73] as const;
/** Whence one looks: X is forward, Y up, Z to the person's right. */
const VIEWS: Record<string, readonly [number, number, number]> = {
  Oblique: OBLIQUE, Front: [1, 0, 0], Right: [0, 0, 1], Left: [0, 0, -1], Back: [-1, 0, 0], Above: [0, 1, 0.001],
};
export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(40, 1, 0.05, 200);
  readonly canvas = h("canvas", { tabindex: 0, role: "img" });
  readonly element = h("div", { class: "stage" }, this.canvas, this.viewButtons());
  /** Called after each picture. */
  drawn: () => void = () => undefined;
  private readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private grid: GridHelper | null = null;
  private waiting = 0;
  /** Called when bones are to have fewer triangles, or all. */
  detailed: (coarse: boolean) => void = () => undefined;
  private readonly pace: Pace;
  private moving = false;

  /** @throws Error where the browser has no WebGL. */
  constructor(label: string, signal: AbortSignal) {
    this.canvas.setAttribute("aria-label", `${label}. Arrow keys turn it, plus and minus move nearer and away.`);
    const software = isSoftware();
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: !software, powerPreference: "high-performance" });
    this.pace = new Pace(software);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => this.move(true));
    this.controls.addEventListener("end", () => this.move(this.playing));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.scene.add(new HemisphereLight(0xffffff, 0x8899aa, 2.2));
    const sun = new DirectionalLight(0xffffff, 1.8);
    sun.position.set(2, 5, 3);
    this.scene.add(sun);
    this.look(new Vector3(0, 0.85, 0), 1.8, 1.2);
    this.paint(theme());
    onTheme((chosen) => this.paint(chosen), signal);
    addEventListener("beforeprint", () => this.drawNow(), { signal });
    const resizing = new ResizeObserver(() => this.resize());
    resizing.observe(this.element);
    signal.addEventListener("abort", () => {
      resizing.disconnect();
      cancelAnimationFrame(this.waiting);
      this.waiting = -1;
      this.controls.dispose();
      this.renderer.dispose();
      this.renderer.forceContextLoss();
    });
  }

  /** Look from the front right at what is so high and wide, m, around a point. */
  look(target: Vector3, high: number, wide: number): void {
    const half = Math.tan(((this.camera.fov / 2) * Math.PI) / 180);
    this.distance = (ROOM * Math.max(high, wide / Math.max(this.camera.aspect, 0.5))) / (2 * half);
    this.controls.target.copy(target);
    this.from("Oblique");
  }

  /** Look from one of the usual sides at what is looked at. */
  private from(view: string): void {
    this.camera.position.copy(this.target).add(new Vector3(...(VIEWS[view] ?? OBLIQUE)).normalize().multiplyScalar(this.distance));
    this.controls.update();
    this.draw();
  }

  private distance = 4;

  private viewButtons(): HTMLElement {
    return h("div", { class: "views", role: "group", "aria-label": "View from" }, ...Object.keys(VIEWS).map((name) =>
      h("button", { class: "small", onclick: () => this.from(name) }, name)));
  }

  /** Go along with what moves: shift what is looked at, and the camera as much. */
  follow(shift: Vector3): void {
    this.controls.target.add(shift);
    this.camera.position.add(shift);
    this.controls.update();
  }

  get target(): Vector3 {
    return this.controls.target;
  }

  /** Draw soon, once. */
  draw(): void {
    if (this.waiting !== 0) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.drawNow();
    });
  }

  /** Draw at once; while playing this is called once for each picture. */
  drawNow(): void {
    if (this.waiting === -1) return;
    this.renderer.render(this.scene, this.camera);
    this.drawn();
  }

  /** What is seen now, as a PNG. */
  picture(): Promise<Blob | null> {
    this.renderer.render(this.scene, this.camera); // what is drawn is kept only until the browser shows it
    return new Promise((resolve) => this.canvas.toBlob(resolve, "image/png"));
  }

  /** Whether something plays: quickly drawn then, in full when it rests. */
  play(playing: boolean): void {
    this.playing = playing;
    this.move(playing);
  }

  private playing = false;

  private move(moving: boolean): void {
    this.moving = moving;
    this.detailed(this.quality.coarse);
    this.resize();
  }

  private get quality(): Quality {
    return this.moving ? this.pace.moving : this.pace.resting;
  }

  /** Tell how long a picture took, so that a slow machine gets fewer pixels instead of fewer pictures. */
  paced(milliseconds: number): void {
    if (this.pace.took(milliseconds)) this.move(this.moving);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.element;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.renderer.setPixelRatio(this.quality.ratio);
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.drawNow();
  }

  private paint(chosen: Theme): void {
    const ink = inkOf(chosen);
    this.scene.background = new Color(chosen === "dark" ? "#1a2027" : "#eef1f5");
    if (this.grid !== null) this.scene.remove(this.grid);
    this.grid = new GridHelper(12, 24, ink.quiet, ink.line);
    this.scene.add(this.grid);
    this.draw();
  }

  private key(event: KeyboardEvent): void {
    const turns: Record<string, [number, number]> = {
      ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN],
    };
    const turn = turns[event.key];
    const zoom = event.key === "+" ? NEARER : event.key === "-" ? 1 / NEARER : 1;
    if ((turn === undefined && zoom === 1) || event.ctrlKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    const offset = this.camera.position.clone().sub(this.target);
    const polar = new Spherical().setFromVector3(offset);
    polar.theta += turn?.[0] ?? 0;
    polar.phi = Math.min(Math.max(polar.phi + (turn?.[1] ?? 0), 0.05), Math.PI - 0.05);
    polar.radius *= zoom;
    this.camera.position.copy(this.target).add(offset.setFromSpherical(polar));
    this.controls.update();
    this.draw();
  }
}
