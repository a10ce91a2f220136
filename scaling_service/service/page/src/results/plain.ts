/** A result without a view of its own: its numbers as a tree, and everything to take away. */

import { part } from "../api/connection.ts";
import { getResult, listFiles } from "../api/jobs.ts";
import { h } from "../ui/dom.ts";
import { figures } from "../ui/words.ts";
import { parts, type ResultView } from "./result.ts";

const DEEP = 1;

export const plain: ResultView = async (found) => {
  const files = await listFiles(found.job.id);
  const inSpace = { name: "space", title: "In space", handled: true, show: async (place: HTMLElement) => (await part(() => import("./space.ts"))).space(found, place, {}) };
  await parts("Parts of the result", found, [
    {
      name: "numbers",
      title: "Numbers",
      show: async (place) => void place.append(tree(await getResult<unknown>(found.job.id, found.signal), 0)),
    },
    ...(files.some(({ name }) => name === "scene/scene.json") ? [inSpace] : []),
  ]);
};

function tree(value: unknown, depth: number): HTMLElement {
  if (typeof value !== "object" || value === null) return h("span", null, leaf(value));
  const entries = Object.entries(value);
  return h(
    "dl",
    { class: "tree" },
    ...entries.map(([name, one]) =>
      typeof one === "object" && one !== null
        ? h("div", null, h("details", { open: depth < DEEP && Object.keys(one).length < 20 },
            h("summary", null, `${name} (${Object.keys(one).length})`), tree(one, depth + 1)))
        : h("div", null, h("dt", null, name), h("dd", null, leaf(one)))),
  );
}

const leaf = (value: unknown): string => (typeof value === "number" ? figures(value, 5) : String(value ?? "–"));
