/** Frames of an array that lies in a file: fetched in blocks around what is looked at.
 *
 * Until a block is there, the overview stands in for it, so that nothing waits.
 */

import { getBytes } from "../api/http.ts";
import type { ArrayEntry } from "../api/schema.ts";

const BLOCK_BYTES = 1 << 20;
/** Of one array: enough for a minute around the cursor, little enough for many arrays. */
const MOST_BLOCKS = 48;
/** A cursor that is dragged passes many blocks; only where it stays this long are they fetched. */
const STAYS_MS = 50;

export class Frames {
  readonly count: number;
  /** Numbers of one frame. */
  readonly width: number;
  /** Frames of one block. */
  readonly block: number;
  private readonly blocks = new Map<number, Float32Array | null>();
  private overview: Float32Array | null = null;
  /** The block where the cursor is, until it is fetched. */
  private awaited: { place: number; timer: number } | null = null;

  /**
   * @param path from the name of a file to where it is fetched.
   * @param changed called when more is there.
   */
  constructor(
    private readonly stored: ArrayEntry,
    private readonly path: (file: string) => string,
    private readonly signal: AbortSignal,
    private readonly changed: () => void,
  ) {
    const [count = 0, ...rest] = stored.shape;
    this.count = count;
    this.width = rest.reduce((product, size) => product * size, 1);
    this.block = Math.max(1, Math.floor(BLOCK_BYTES / (4 * Math.max(1, this.width))));
  }

  /** What must be there before anything is shown: the overview, or the beginning. */
  async begin(): Promise<void> {
    const { overview } = this.stored;
    if (overview === null) return this.load(0);
    this.overview = floats(await getBytes(this.path(overview.file), { signal: this.signal }));
    this.want(0);
  }

  /** One frame; the nearest of the overview while the frame itself is on its way. */
  at(frame: number): Float32Array | null {
    const place = Math.floor(frame / this.block);
    const block = this.blocks.get(place);
    if (block) return this.cut(block, frame - place * this.block);
    this.want(frame);
    const step = this.stored.overview?.step ?? 1;
    return this.overview === null ? null : this.cut(this.overview, Math.round(frame / step));
  }

  /** All frames, or every `step`-th of what is long. */
  async whole(): Promise<{ values: Float32Array; step: number }> {
    const { file, overview } = this.stored;
    return { values: floats(await getBytes(this.path(overview?.file ?? file), { signal: this.signal })), step: overview?.step ?? 1 };
  }

  /** Have a frame and those that follow ready, if the cursor stays. */
  private want(frame: number): void {
    const place = Math.floor(frame / this.block);
    if (place === this.awaited?.place) return;
    clearTimeout(this.awaited?.timer);
    this.awaited = { place, timer: window.setTimeout(() => this.fetchFrom(place), STAYS_MS) };
  }

  private fetchFrom(place: number): void {
    this.awaited = null;
    if (this.signal.aborted) return;
    for (const wanted of [place, place + 1]) {
      if (wanted * this.block < this.count && !this.blocks.has(wanted)) void this.load(wanted);
    }
  }

  private cut(values: Float32Array, row: number): Float32Array {
    const last = Math.floor(values.length / this.width) - 1;
    const start = Math.min(row, last) * this.width;
    return values.subarray(start, start + this.width);
  }

  private async load(place: number): Promise<void> {
    this.blocks.set(place, null);
    try {
      this.blocks.set(place, await this.fetched(place));
      this.forget(place);
      this.changed();
    } catch (error) {
      this.blocks.delete(place);
      throw error;
    }
  }

  private async fetched(place: number): Promise<Float32Array> {
    const first = place * this.block;
    const last = Math.min(first + this.block, this.count);
    const [from, to] = [first, last].map((frame) => 4 * this.width * frame) as [number, number];
    const headers: Record<string, string> = first === 0 && last === this.count ? {} : { Range: `bytes=${from}-${to - 1}` };
    return floats(await getBytes(this.path(this.stored.file), { headers, signal: this.signal }));
  }

  /** Let the blocks go that are furthest from what was just fetched. */
  private forget(place: number): void {
    const far = [...this.blocks.keys()].sort((a, b) => Math.abs(a - place) - Math.abs(b - place)).slice(MOST_BLOCKS);
    for (const one of far) this.blocks.delete(one);
  }
}

/** All computers with browsers are little-endian. */
function floats(content: ArrayBuffer): Float32Array {
  return new Float32Array(content, 0, Math.floor(content.byteLength / 4));
}
