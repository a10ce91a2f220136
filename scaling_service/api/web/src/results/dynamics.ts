import { plain } from "./plain.ts"; export const dynamics = plain;
