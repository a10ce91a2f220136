import type { Finished } from "./result.ts"; export const forces = (_f: Finished, place: HTMLElement): void => void place.append("later");
