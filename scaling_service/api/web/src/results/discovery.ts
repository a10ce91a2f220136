import { plain } from "./plain.ts"; export const discovery = plain;
