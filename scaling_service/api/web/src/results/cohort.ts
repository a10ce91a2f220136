import { plain } from "./plain.ts"; export const cohort = plain;
