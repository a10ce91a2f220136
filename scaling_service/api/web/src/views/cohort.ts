import type { View } from "./view.ts"; export const cohort: View = ({ main }) => void main.append("later");
