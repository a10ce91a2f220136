/** One model in space: its bones, joint centres, knee axes and markers, moved by the poses of its segments. */

import type { BodyEntry, PlacedEntry } from "../api/schema.ts";
import { Color, Group, type BufferGeometry, Mesh, MeshLambertMaterial, Quaternion, Vector3, type Object3D } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { BONE } from "../ui/palette.ts";
import { coarsened } from "./coarse.ts";
import { Dots } from "./dots.ts";
import { wellOrdered } from "./order.ts";
import { Strokes } from "./strokes.ts";

const POSE = 7;
/** Chosen: nearly the colour of the legend, with so much of bone that shapes are read. */
const TINT = 0.8;

interface Carried {
  segment: number;
  at: Vector3;
}

export class Body {
  readonly group = new Group();
  /** Joint centre to the place of its point. */
  private readonly centres = new Map<string, number>();
  private readonly segments: Group[];
  private readonly points: Carried[] = [];
  private readonly placed: Float32Array;
  private readonly pairs: [number, number][] = [];
  private readonly markers: number[];
  private readonly markerDots: Dots;
  private readonly sticks: Strokes;
  private readonly gaps: Strokes;
  private readonly toLabels: number[];
  private readonly bones: Bone[] = [];

  /** @param labels of the measured markers, in their order. */
  constructor(
    readonly entry: BodyEntry,
    private readonly colour: string,
    labels: readonly string[],
  ) {
    this.segments = entry.segments.map(() => new Group());
    for (const segment of this.segments) this.group.add(segment);
    this.markers = entry.markers.map(({ segment, xyz_m }) => this.point(segment, xyz_m));
    this.toLabels = entry.markers.map(({ name }) => labels.indexOf(name));
    this.connect();
    this.placed = new Float32Array(3 * this.points.length);
    this.markerDots = new Dots(this.markers.length, 0.0085, colour);
    this.sticks = new Strokes(this.pairs.length, colour);
    this.gaps = new Strokes(this.markers.length, colour);
    this.group.add(this.markerDots.mesh, this.sticks.lines, this.gaps.lines);
  }

  /** Put the bones in: one node for each segment, in the segment's frame. */
  async dress(glb: ArrayBuffer): Promise<void> {
    const { scene } = await new GLTFLoader().parseAsync(glb, "");
    for (const node of [...scene.children]) {
      const place = this.entry.segments.findIndex(({ name }) => name === node.name);
      const group = this.segments[place];
      if (group === undefined) continue;
      const simple = this.entry.segments[place]?.shape === "simple";
      this.bones.push(...prepared(node, tinted(this.colour), simple));
      group.add(node);
    }
  }

  /** Move everything to a frame: poses of all segments, where the markers were measured, and where the
   * model's own are where they glide. */
  put(poses: Float32Array, measured: Float32Array | null, gliding: Float32Array | null): void {
    this.segments.forEach((group, k) => {
      const at = POSE * k;
      group.visible = Number.isFinite(poses[at] ?? NaN);
      group.position.set(poses[at] ?? 0, poses[at + 1] ?? 0, poses[at + 2] ?? 0);
      group.quaternion.set(poses[at + 3] ?? 0, poses[at + 4] ?? 0, poses[at + 5] ?? 0, poses[at + 6] ?? 1);
    });
    this.place(poses);
    if (gliding !== null) this.glide(gliding);
    this.markerDots.put(this.placed); // markers are the first of the points
    this.pairs.forEach(([a, b], k) => this.sticks.put(k, this.placed, 3 * a, this.placed, 3 * b));
    this.sticks.done();
    if (measured === null) return;
    this.toLabels.forEach((label, k) => this.gaps.put(k, this.placed, 3 * (this.markers[k] ?? 0), measured, label < 0 ? NaN : 3 * label));
    this.gaps.done();
  }

  /** Draw the bones with fewer triangles, or with all. */
  detail(coarse: boolean): void {
    for (const { mesh, fine, rough } of this.bones) mesh.geometry = coarse ? rough : fine;
  }

  showBones(shown: boolean): void {
    for (const group of this.segments) for (const child of group.children) child.visible = shown;
  }

  showMarkers(shown: boolean): void {
    this.markerDots.mesh.visible = shown;
    this.gaps.lines.visible = shown;
  }

  /** Where a joint centre is, x, y, z, m; null where the body has none of that name. */
  centre(name: string): Float32Array | null {
    const place = this.centres.get(name);
    return place === undefined ? null : this.placed.subarray(3 * place, 3 * place + 3);
  }

  private place(poses: Float32Array): void {
    const at = new Vector3();
    const turn = new Quaternion();
    this.points.forEach(({ segment, at: local }, k) => {
      const p = POSE * segment;
      turn.set(poses[p + 3] ?? 0, poses[p + 4] ?? 0, poses[p + 5] ?? 0, poses[p + 6] ?? 1);
      at.copy(local).applyQuaternion(turn);
      this.placed[3 * k] = at.x + (poses[p] ?? NaN);
      this.placed[3 * k + 1] = at.y + (poses[p + 1] ?? NaN);
      this.placed[3 * k + 2] = at.z + (poses[p + 2] ?? NaN);
    });
  }

  private glide(gliding: Float32Array): void {
    this.toLabels.forEach((label, k) => {
      if (label >= 0) this.placed.set(gliding.subarray(3 * label, 3 * label + 3), 3 * (this.markers[k] ?? 0));
    });
  }

  private point(segment: string, at: PlacedEntry["xyz_m"]): number {
    const place = this.entry.segments.findIndex(({ name }) => name === segment);
    this.points.push({ segment: Math.max(place, 0), at: new Vector3(...at) });
    return this.points.length - 1;
  }

  /** Sticks from each segment's origin to the joint centres that it carries; a root's centres hang together. */
  private connect(): void {
    for (const { name, parent } of this.entry.segments) {
      const centres = this.entry.centres.filter(({ segment }) => segment === name).map(({ name: centre, xyz_m }) => {
        const place = this.point(name, xyz_m);
        this.centres.set(centre, place);
        return place;
      });
      const isRoot = parent === null || !this.entry.segments.some((one) => one.name === parent);
      if (isRoot && centres.length > 1) {
        centres.slice(1).forEach((centre, k) => this.pairs.push([centres[k] ?? 0, centre]));
      } else if (centres.length > 0) {
        const origin = this.point(name, [0, 0, 0]);
        for (const centre of centres) this.pairs.push([origin, centre]);
      }
    }
    for (const { segment, ends_m } of this.entry.axes) this.pairs.push([this.point(segment, ends_m[0]), this.point(segment, ends_m[1])]);
  }
}

function tinted(colour: string): Color {
  return new Color(BONE).lerp(new Color(colour), TINT);
}

interface Bone {
  mesh: Mesh;
  fine: BufferGeometry;
  rough: BufferGeometry;
}

/** Shapes that only stand for bones are seen through. */
function prepared(node: Object3D, colour: Color, simple: boolean): Bone[] {
  const found: Bone[] = [];
  node.traverse((part) => {
    if (!(part instanceof Mesh)) return;
    const fine = part.geometry as BufferGeometry;
    if (!fine.hasAttribute("normal")) fine.computeVertexNormals();
    wellOrdered(fine);
    part.material = new MeshLambertMaterial(simple ? { color: colour, transparent: true, opacity: 0.45, depthWrite: false } : { color: colour });
    found.push({ mesh: part, fine, rough: coarsened(fine) });
  });
  return found;
}
