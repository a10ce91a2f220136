import type { View } from "./view.ts"; export const importing: View = ({ main }) => void main.append("later");
