import { plain } from "./plain.ts"; export const proof = plain;
