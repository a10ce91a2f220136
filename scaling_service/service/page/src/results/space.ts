/** The models of all methods overlaid on bones and markers, played back. */

import { part } from "../api/connection.ts";
import { ask } from "../api/jobs.ts";
import { ROUTES, type Correction, type SceneTrial, type SubjectDocument } from "../api/schema.ts";
import { getSubject, putSubject } from "../api/subjects.ts";
import { mending } from "../imports/mending.ts";
import { link, toJob } from "../routes.ts";
import { sceneOf, pathIn } from "../scene/scene.ts";
import { Playback, type PlaybackOptions } from "../scene/playback.ts";
import { select } from "../ui/choice.ts";
import { h } from "../ui/dom.ts";
import { baseOf, type Finished } from "./result.ts";

/** What puts a marker of a recording right in the subject's document and asks for the same again. */
async function mender({ request, job, signal }: Finished, trial: SceneTrial, used: Record<string, string[]>): Promise<PlaybackOptions["mend"]> {
  const route = ROUTES[job.kind];
  if (typeof request["subject"] !== "string" || route === undefined) return undefined;
  const subject = await getSubject(request["subject"], signal);
  const document = subject.document as unknown as SubjectDocument;
  const { calibration = [], evaluation = [] } = document.trials;
  const file = [...calibration, ...evaluation].find((name) => name.replace(/\.[^.]*$/, "") === trial.name);
  if (file === undefined) return undefined;
  const written = (marker: string): string => used[marker]?.[0] ?? marker;
  const again = async (correction: Correction): Promise<void> => {
    const { [file]: before = [], ...others } = document.corrections ?? {};
    await putSubject({ ...document, corrections: { ...others, [file]: [...before, correction] } });
    location.hash = toJob((await ask(route, request)).id);
  };
  const span = [trial.start_s, trial.start_s + (trial.frames - 1) / trial.rate_hz] as const;
  return (marker, now) => mending({ file, label: written(marker), labels: trial.labels.map(written).sort(), span }, now, "Put it right and run again", again);
}

/** At first only two bodies: more hide each other. */
const AT_FIRST = 2;

/**
 * @param used the labels that were taken for each marker of the model.
 * @param together whether maps of all bodies stand below each other.
 */
export async function space(found: Finished, place: HTMLElement, used: Record<string, string[]>, preferred: readonly string[] = [], together = false): Promise<void> {
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
  const playback = new Playback({ scene, trial, path: pathIn(job.id), shown, frame: Number(at.query.get("frame") ?? 0), signal, together,
    mend: await mender(found, trial, used) });
  place.append(
    h("div", { class: "bar" }, select("Recording", trials, trial.name, (value) => {
      location.hash = link([...baseOf(found), "space"], { trial: value });
    })),
    playback.element,
  );
  await playback.begin();
}
