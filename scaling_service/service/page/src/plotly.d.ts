/** The little of plotly.js that the page uses. */
declare module "plotly.js-cartesian-dist-min" {
  export interface Trace { type: string; [attribute: string]: unknown }
  export type Layout = Record<string, unknown>;
  export interface Drawing { data: Trace[]; layout: Layout }
  export interface Clicked { points: { pointNumber: number | [number, number] }[]; xvals?: number[] }

  interface Plotly {
    react: (place: HTMLElement, data: Trace[], layout: Layout, config: object) => Promise<unknown>;
    Fx: {
      hover: (place: HTMLElement, at: { xval: number }, subplot: string, quietly: boolean) => void;
      unhover: (place: HTMLElement) => void;
    };
    purge: (place: HTMLElement) => void;
    toImage: (drawing: Drawing, options: object) => Promise<string>;
    Plots: { resize: (place: HTMLElement) => Promise<unknown> };
  }
  const plotly: Plotly;
  export default plotly;
}
