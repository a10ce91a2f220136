/** The models of all methods overlaid on bones and markers, played back. */

import { part } from "../api/connection.ts";
import { link } from "../routes.ts";
import { sceneOf, pathIn } from "../scene/scene.ts";
import { Playback } from "../scene/playback.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { baseOf, type Finished } from "./result.ts";

/** At first only two bodies: more hide each other. */
const AT_FIRST = 2;

export async function space(found: Finished, place: HTMLElement, preferred: readonly string[] = [], together = false): Promise<void> {
  const { job, place: at, signal } = found;
  // The drawing of figures takes a moment to start: now, and not while somebody drags the cursor.
  const [scene] = await Promise.all([sceneOf(job.id), part(() => import("../charts/engine.ts"))]);
  if (signal.aborted) return;
  const named = at.query.get("trial");
  const trial = scene.trials.find(({ name }) => name === named) ?? scene.trials.find(({ role }) => role === "evaluation") ?? scene.trials[0];
  if (trial === undefined) {
    place.append(h("p", null, "No movement was recorded, so there is nothing to play back."));
    return;
  }
  const bodies = scene.bodies.map(({ name }) => name).filter((name) => name in trial.motions);
  const shown = [...new Set([...preferred.filter((name) => bodies.includes(name)), ...bodies])].slice(0, AT_FIRST);
  const trials = scene.trials.map(({ name, role }) => ({ value: name, text: `${name} (${role === "evaluation" ? "held out" : "fitted"})` }));
  const playback = new Playback({ scene, trial, path: pathIn(job.id), shown, frame: Number(at.query.get("frame") ?? 0), signal, together });
  place.append(
    h("div", { class: "bar" }, select("Recording", trials, trial.name, (value) => {
      location.hash = link([...baseOf(found), "space"], { trial: value });
    })),
    playback.element,
  );
  await playback.begin();
}
