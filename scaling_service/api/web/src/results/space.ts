import type { Finished } from "./result.ts"; export const space = (_f: Finished, place: HTMLElement): void => void place.append("later");
