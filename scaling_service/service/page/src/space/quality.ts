/** How well things are drawn while they move: as well as the machine is fast. At rest they are drawn in full. */

export interface Quality {
  /** Pixels drawn for each pixel of the page, along each side. */
  ratio: number;
  /** Whether bones have fewer triangles. */
  coarse: boolean;
}

const LEVELS: Quality[] = [
  { ratio: 2, coarse: false },
  { ratio: 1, coarse: false },
  { ratio: 0.8, coarse: true },
  { ratio: 0.6, coarse: true },
  { ratio: 0.45, coarse: true },
];

/** Pictures that take longer than this are too slow, and with this there is room for more. */
const SLOW_MS = 24;
const FAST_MS = 17.5;
/** Pictures that are looked at before anything is changed. */
const LOOKED_AT = 8;

export class Pace {
  private level: number;
  private times: number[] = [];
  private tooMuch = -1;

  /** @param software whether the browser draws without a graphics card. */
  constructor(software: boolean) {
    this.level = software ? 2 : devicePixelRatio > 1 ? 0 : 1;
  }

  get moving(): Quality {
    return LEVELS[this.level] ?? { ratio: 1, coarse: true };
  }

  get resting(): Quality {
    return { ratio: Math.min(2, Math.max(1, devicePixelRatio)), coarse: false };
  }

  /** Tell how long a picture took; whether the quality while moving has changed. */
  took(milliseconds: number): boolean {
    this.times.push(milliseconds);
    if (this.times.length < LOOKED_AT) return false;
    const usual = this.times.sort((a, b) => a - b)[LOOKED_AT >> 1] ?? 0;
    this.times = [];
    if (usual > SLOW_MS && this.level < LEVELS.length - 1) {
      this.tooMuch = this.level; // is not tried again
      this.level += 1;
      return true;
    }
    const next = LEVELS[this.level - 1];
    if (usual >= FAST_MS || next === undefined || this.level - 1 === this.tooMuch || next.ratio > devicePixelRatio) return false;
    this.level -= 1;
    return true;
  }
}

/** Whether the browser draws without a graphics card. */
export function isSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const info = context?.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = info === null || info === undefined ? "" : context?.getParameter(info.UNMASKED_RENDERER_WEBGL);
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(String(name));
}
