import type { Finished } from "./result.ts"; export const angles = (_f: Finished, place: HTMLElement): void => void place.append("later");
