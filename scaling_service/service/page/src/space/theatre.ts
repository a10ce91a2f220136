/** One recording in space: measured markers, the bodies that are shown, plates and forces, at one frame. */

import { getBytes } from "../api/http.ts";
import type { ArrayEntry, BodyEntry, PlateEntry } from "../api/schema.ts";
import { Vector3, type Object3D } from "three";
import { inkOf } from "../charts/ink.ts";
import { Frames } from "../scene/frames.ts";
import { onTheme, theme } from "../ui/theme.ts";
import { Body } from "./body.ts";
import { Dots } from "./dots.ts";
import { Ground } from "./ground.ts";
import { joined } from "./joined.ts";
import { Names } from "./names.ts";
import { Stage } from "./stage.ts";
import { Strokes } from "./strokes.ts";

const PICKED = "#e69f00";
const LINKS = "#8492a0";
/** Chosen: twice what a joint centre is known to from bones; two models that differ by more are not the same. */
export const FAR_MM = 10;
/** Chosen: a marker above this sits on the trunk of an adult, and a head is so much above it. */
const TRUNK_M = 1.1;
const HEAD_M = 0.15;
/** Who goes further than this is followed at first, lest they walk off the stage. */
const GOES_M = 1;

export interface Play {
  labels: readonly string[];
  measured: ArrayEntry;
  plates: readonly PlateEntry[];
  force: ArrayEntry | null;
  centre_of_pressure: ArrayEntry | null;
  /** The segment of each marker, where known: these are joined by lines. */
  segments?: readonly (string | undefined)[];
  /** What a label is called where it is pointed at. */
  named?: (label: string) => string;
  /** Bodies with their poses, in the order of their drawing. */
  bodies: readonly { entry: BodyEntry; poses: ArrayEntry; placed: ArrayEntry | null; colour: string }[];
}

interface Actor {
  body: Body;
  poses: Frames;
  gliding: Frames | null;
  shown: boolean;
  dressed: boolean;
}

export class Theatre {
  readonly stage: Stage;
  /** Called with the label of a marker that was clicked, or null beside them. */
  picked: (label: string | null) => void = () => undefined;
  /** Called with the label of a marker that is pointed at, null beside them. */
  set pointed(told: (label: string | null) => void) {
    this.names.told = told;
  }
  /** Called with two bodies' names and how far their joint centres are apart, the most first; without any for others. */
  compared: (names: readonly string[], differences: readonly { name: string; mm: number }[]) => void = () => undefined;
  following = false;
  private readonly dots: Dots;
  private readonly measured: Frames;
  private readonly ground: Ground;
  private readonly lines: Strokes;
  private readonly names: Names;
  private readonly far: Dots;
  private readonly joints: readonly string[];
  private readonly forces: { push: Frames; at: Frames } | null;
  private readonly actors = new Map<string, Actor>();
  private frame = 0;
  private links: [number, number][] = [];
  private centre: Vector3 | null = null;
  private chosen: string | null = null;
  private bones = true;
  private markers = true;

  constructor(
    private readonly play: Play,
    private readonly path: (file: string) => string,
    label: string,
    private readonly signal: AbortSignal,
  ) {
    this.stage = new Stage(label, signal);
    const frames = (stored: ArrayEntry): Frames => new Frames(stored, path, signal, () => this.show(this.frame));
    this.measured = frames(play.measured);
    this.dots = new Dots(play.labels.length, 0.011, inkOf(theme()).measured);
    this.ground = new Ground(play.plates);
    this.lines = new Strokes(play.labels.length, LINKS);
    this.names = new Names(this.stage, play.labels.map((label) => play.named?.(label) ?? label), play.labels);
    this.joints = [...new Set(play.bodies.flatMap(({ entry }) => entry.centres.map(({ name }) => name)))];
    this.far = new Dots(2 * this.joints.length, 0.013, PICKED, true);
    const { force, centre_of_pressure } = play;
    this.forces = force === null || centre_of_pressure === null ? null : { push: frames(force), at: frames(centre_of_pressure) };
    for (const { entry, poses, placed, colour } of play.bodies) {
      const body = new Body(entry, colour, play.labels);
      this.actors.set(entry.name, { body, poses: frames(poses), gliding: placed && frames(placed), shown: false, dressed: false });
    }
    this.stage.scene.add(this.dots.mesh, this.ground.group, this.lines.lines, this.far.mesh);
    onTheme(() => this.repaint(), signal);
    this.stage.detailed = (coarse) => this.detail(coarse);
    this.pickOnClick();
  }

  private coarse = false;

  private detail(coarse: boolean): void {
    this.coarse = coarse;
    for (const { body } of this.actors.values()) body.detail(coarse);
  }

  /** Fetch what the first picture needs, and show it. */
  async begin(shown: readonly string[], frame: number): Promise<void> {
    const forces = this.forces === null ? [] : [this.forces.push.begin(), this.forces.at.begin()];
    await Promise.all([this.measured.begin(), ...forces, ...shown.map((name) => this.showBody(name, true))]);
    this.frame = frame;
    this.links = joined(this.measured.at(frame) ?? new Float32Array(), this.play.segments ?? []);
    const centre = this.centreAt(frame);
    const last = this.centreAt(this.measured.count - 1);
    this.following = centre !== null && last !== null && centre.distanceTo(last) > GOES_M;
    if (centre !== null) this.look(frame, centre);
    this.show(frame);
  }

  /** Show or hide one body; what it needs is fetched when it is first shown. */
  async showBody(name: string, shown: boolean): Promise<void> {
    const actor = this.actors.get(name);
    if (actor === undefined) return;
    actor.shown = shown;
    if (!shown) this.stage.scene.remove(actor.body.group);
    if (shown) {
      await Promise.all([actor.poses.begin(), actor.gliding?.begin()]);
      this.stage.scene.add(actor.body.group);
      if (!actor.dressed && actor.body.entry.bones !== null) await this.dress(actor, actor.body.entry.bones);
    }
    this.show(this.frame);
  }

  /** Put signs on the floor below the middle of the markers. */
  mark(...signs: Object3D[]): void {
    const centre = this.centreAt(this.frame) ?? new Vector3();
    for (const sign of signs) {
      sign.position.set(centre.x, 0.01, centre.z);
      this.stage.scene.add(sign);
    }
    this.stage.draw();
  }

  showBones(shown: boolean): void {
    this.bones = shown;
    for (const { body } of this.actors.values()) body.showBones(shown);
    this.stage.draw();
  }

  showMarkers(shown: boolean): void {
    this.markers = shown;
    for (const { body } of this.actors.values()) body.showMarkers(shown);
    this.stage.draw();
  }

  showNames(shown: boolean): void {
    this.names.all = shown;
    this.stage.draw();
  }

  showMeasured(shown: boolean): void {
    this.dots.mesh.visible = shown;
    this.stage.draw();
  }

  /** Move everything to a frame. */
  show(frame: number): void {
    this.put(frame);
    this.stage.draw();
  }

  /** Move everything to a frame and draw it within this very picture. */
  showNow(frame: number): void {
    this.put(frame);
    this.stage.drawNow();
  }

  /** Mark a marker. */
  pick(label: string | null): void {
    if (label === this.chosen) return;
    this.chosen = label;
    this.names.keep(label);
    this.repaint();
  }

  private put(frame: number): void {
    this.frame = frame;
    const measured = this.measured.at(frame);
    if (measured !== null) {
      this.dots.put(measured);
      this.names.put(measured);
      this.links.forEach(([a, b], k) => this.lines.put(k, measured, 3 * a, measured, 3 * b));
      this.lines.done();
    }
    for (const { body, poses, gliding, shown } of this.actors.values()) {
      const pose = shown ? poses.at(frame) : null;
      if (pose !== null) body.put(pose, measured, gliding?.at(frame) ?? null);
    }
    this.compare();
    const push = this.forces?.push.at(frame) ?? null;
    const at = this.forces?.at.at(frame) ?? null;
    if (push !== null && at !== null) this.ground.put(push, at);
    if (this.following) this.goAlong(frame);
    else this.centre = null;
  }

  /** Light the joint centres in which the two bodies that are shown differ. */
  private compare(): void {
    const [one, other, ...more] = [...this.actors.values()].filter(({ shown }) => shown).map(({ body }) => body);
    const lit = new Float32Array(6 * this.joints.length).fill(NaN);
    const found: { name: string; mm: number }[] = [];
    if (one !== undefined && other !== undefined && more.length === 0) {
      this.joints.forEach((name, k) => {
        const [a, b] = [one.centre(name), other.centre(name)];
        const mm = a === null || b === null ? NaN : 1000 * Math.hypot(...[0, 1, 2].map((axis) => (a[axis] ?? NaN) - (b[axis] ?? NaN)));
        if (!Number.isFinite(mm)) return;
        found.push({ name, mm });
        if (a !== null && b !== null && mm >= FAR_MM) lit.set([...a, ...b], 6 * k);
      });
    }
    this.far.put(lit);
    this.compared([one, other].flatMap((body) => (body === undefined ? [] : [body.entry.name])), found.sort((a, b) => b.mm - a.mm));
  }

  private goAlong(frame: number): void {
    const centre = this.centreAt(frame);
    if (centre !== null && this.centre !== null) this.stage.follow(centre.clone().sub(this.centre).setY(0));
    if (centre !== null) this.centre = centre;
  }

  /** The middle of the measured markers. */
  private centreAt(frame: number): Vector3 | null {
    const measured = this.measured.at(frame);
    if (measured === null) return null;
    let [x, y, z, count] = [0, 0, 0, 0];
    for (let k = 0; k < measured.length; k += 3) {
      if (Number.isNaN(measured[k])) continue;
      x += measured[k] ?? 0;
      y += measured[k + 1] ?? 0;
      z += measured[k + 2] ?? 0;
      count += 1;
    }
    return count === 0 ? null : new Vector3(x, y, z).divideScalar(count);
  }

  /** See everything from the floor to above the highest marker: heads stand above those of a trunk. */
  private look(frame: number, centre: Vector3): void {
    const measured = this.measured.at(frame) ?? new Float32Array();
    let [top, wide] = [0.4, 0.4];
    for (let k = 0; k < measured.length; k += 3) {
      const [x = NaN, y = NaN, z = NaN] = measured.subarray(k, k + 3);
      if (Number.isNaN(x)) continue;
      top = Math.max(top, y);
      wide = Math.max(wide, 2 * Math.hypot(x - centre.x, z - centre.z));
    }
    const high = top + (top > TRUNK_M ? HEAD_M : 0);
    this.stage.look(new Vector3(centre.x, high / 2, centre.z), high, wide);
  }

  private async dress(actor: Actor, file: string): Promise<void> {
    actor.dressed = true;
    await actor.body.dress(await getBytes(this.path(file), { signal: this.signal }));
    actor.body.detail(this.coarse);
    actor.body.showBones(this.bones);
    actor.body.showMarkers(this.markers);
  }

  private repaint(): void {
    const usual = inkOf(theme()).measured;
    this.play.labels.forEach((label, k) => this.dots.paint(k, label === this.chosen ? PICKED : usual));
    this.stage.draw();
  }

  private pickOnClick(): void {
    const { canvas } = this.stage;
    let down: [number, number] = [0, 0];
    canvas.addEventListener("pointerdown", ({ clientX, clientY }) => void (down = [clientX, clientY]));
    canvas.addEventListener("click", ({ clientX, clientY, offsetX, offsetY }) => {
      if (Math.hypot(clientX - down[0], clientY - down[1]) > 4) return; // it was turned
      const label = this.names.nearest(offsetX, offsetY);
      this.pick(label);
      this.picked(label);
    });
  }
}
