/** Models of a comparison in space, beside the words: what the methods make of one moment, to be turned and played. */

import { Player } from "../space/player.ts";
import { FAR_MM, Theatre } from "../space/theatre.ts";
import { pathIn, sceneOf } from "../scene/scene.ts";
import { h } from "../ui/dom.ts";
import { styles } from "../ui/palette.ts";
import { chipOf } from "../ui/table.ts";

/** @param wanted methods whose models are shown, the first two that there are. */
export async function picture(job: string, wanted: readonly string[], signal: AbortSignal): Promise<HTMLElement | null> {
  const scene = await sceneOf(job);
  const trial = scene.trials.find(({ role }) => role === "evaluation") ?? scene.trials[0];
  if (trial === undefined || signal.aborted) return null;
  const colours = styles(scene.bodies.map(({ name }) => name));
  const shown = wanted.filter((name) => name in trial.motions).slice(0, 2);
  const bodies = scene.bodies.flatMap((entry) => {
    const motion = trial.motions[entry.name];
    return motion === undefined || !shown.includes(entry.name) ? []
      : [{ entry, poses: motion.poses, placed: motion.placed, colour: colours.get(entry.name)?.colour ?? "" }];
  });
  const theatre = new Theatre({ ...trial, bodies }, pathIn(job), `Models of ${shown.join(" and ")} in ${trial.name}`, signal);
  const apart = h("span", { class: "apart", hidden: true }, `joint centres ${FAR_MM} mm apart or more`);
  theatre.compared = (_, differences) => void (apart.hidden = !differences.some(({ mm }) => mm >= FAR_MM));
  const player = new Player(trial.frames, trial.rate_hz, trial.start_s, (frame) => theatre.showNow(frame), () => theatre.stage, signal);
  const middle = Math.floor(trial.frames / 2);
  void theatre.begin(shown, middle).then(() => player.go(middle));
  const legend = shown.map((name) => h("span", { class: "labelled" }, chipOf(colours.get(name)?.colour ?? ""), name));
  return h("figure", { class: "picture" }, theatre.stage.element, player.element,
    h("figcaption", null, ...legend, h("span", { class: "measured" }, `measured markers, ${trial.name}`), apart));
}
