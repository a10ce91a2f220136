/** One report of a person: what all that ran on them says, to be read through, signed and printed. */

import { getResult } from "../api/jobs.ts";
import type { ComparisonDocument, DiscoveryDocument, DynamicsDocument, JobDocument, Person, SubjectDetail, SubjectDocument, Vocabulary } from "../api/schema.ts";
import { toJob, toSubject } from "../routes.ts";
import { bullets, callout } from "../ui/blocks.ts";
import { h } from "../ui/dom.ts";
import { sentence } from "../ui/problem.ts";
import { cell, table } from "../ui/table.ts";
import { moment, number, signed, words } from "../ui/words.ts";
import { clinical } from "./clinical.ts";
import { told } from "./discovery.ts";
import { gates } from "./residuals.ts";
import { lengthInterval } from "./sizes.ts";
import { trust } from "./verdict.ts";

/** Kinds of results that a person's report has, in its order. */
export const CHAPTERS = ["scaling", "dynamics", "discovery"] as const;
export type Chapter = (typeof CHAPTERS)[number];

/** The newest job of each kind. */
export type Newest = Partial<Record<Chapter, JobDocument>>;

const LACKS: Record<Chapter, readonly [title: string, said: string]> = {
  scaling: ["Verdict", "No models were compared yet, so there are no sizes and angles either."],
  dynamics: ["Forces", "The forces were not checked yet."],
  discovery: ["What the model lacks", "No missing effect was looked for yet."],
};

/** What stands first: who, and what was recorded. */
export function personHead({ document }: SubjectDetail): HTMLElement {
  const { subject, model, trials } = document as unknown as Partial<SubjectDocument> & { subject: Person };
  const facts: [string, string][] = [
    ["sex", subject.sex === "F" ? "female" : subject.sex === "M" ? "male" : "not given"],
    ["height", subject.height_m == null ? "not given" : `${number(subject.height_m, 3)} m`],
    ["mass", subject.mass_kg == null ? "not given" : `${number(subject.mass_kg)} kg`],
    ["model", model ?? "not chosen"],
    ["standing", trials?.static ?? "none"],
    ["fitted", trials?.calibration?.join(", ") || "none"],
    ["held out", trials?.evaluation?.join(", ") || "none"],
  ];
  return h("dl", { class: "facts" }, ...facts.map(([name, text]) => h("div", null, h("dt", null, name), h("dd", null, text))));
}

const chapter = (title: string, job: JobDocument, ...content: (HTMLElement | false)[]): HTMLElement =>
  h("section", null, h("h2", null, title),
    h("p", { class: "quiet" }, `From ${moment(job.finished_at ?? job.created_at)}. `, h("a", { href: toJob(job.id) }, "All of it")), ...content);

/** All chapters that there are, and a sentence for each that lacks. */
export async function personChapters(id: string, newest: Newest, { gait_angles }: Vocabulary, signal: AbortSignal): Promise<HTMLElement[]> {
  const { scaling, dynamics, discovery } = newest;
  const missing = (kind: Chapter): HTMLElement => h("section", null, h("h2", null, LACKS[kind][0]), h("p", { class: "quiet" }, `${LACKS[kind][1]} `, h("a", { href: toSubject(id, "run") }, "To the analyses")));
  return [
    ...(scaling === undefined ? [missing("scaling")] : compared(await getResult<ComparisonDocument>(scaling.id, signal), scaling, gait_angles, signal)),
    dynamics === undefined ? missing("dynamics") : forces(await getResult<DynamicsDocument>(dynamics.id, signal), dynamics),
    discovery === undefined ? missing("discovery") : search(await getResult<DiscoveryDocument>(discovery.id, signal), discovery),
  ];
}

function compared(document: ComparisonDocument, job: JobDocument, angles: Vocabulary["gait_angles"], signal: AbortSignal): HTMLElement[] {
  const { verdict, methods } = document;
  const method = verdict?.method ?? Object.keys(methods)[0] ?? "";
  const found = methods[method];
  const gait = found?.clinical ?? null;
  const read = gait !== null && Object.keys(gait.sides).length > 0;
  return [
    chapter("Verdict", job, verdict !== null && callout(verdict.headline, verdict.tone ?? "plain", bullets(verdict.why)), verdict !== null && trust(verdict)),
    chapter("Sizes", job, found !== undefined && table({
      caption: `Segment lengths by ${method}, mm`,
      name: "person_lengths_mm",
      columns: [{ title: "segment" }, { title: "length" }, { title: "± half its 95 % interval" }],
      rows: Object.entries(found.segment_lengths_mm).map(([name, mm]) => [cell(words(name)), cell(number(mm), mm), cell(number(lengthInterval(found, name)), lengthInterval(found, name))]),
    })),
    chapter("Joint angles", job, gait !== null && read ? clinical(method, gait, angles, 200, signal)
      : h("p", { class: "quiet" }, gait === null || gait.reason === "" ? "This model tells no angles that a clinic reads." : `No whole stride: ${gait.reason}.`)),
  ];
}

const forces = (document: DynamicsDocument, job: JobDocument): HTMLElement =>
  chapter("Forces", job, callout(sentence(document.headline), document.tone, h("p", null, document.verdict)), gates(document));

function search(document: DiscoveryDocument, job: JobDocument): HTMLElement {
  const next = [...new Set(document.effects.flatMap(({ would_separate }) => (would_separate === null ? [] : [would_separate])))];
  return chapter("What the model lacks", job, callout(document.headline, document.tone, told(document.effects.filter(({ carries }) => carries), 1)),
    next.length > 0 && h("div", null, h("h3", null, "To record next"), bullets(next.map(sentence))));
}

/** Two sessions beside each other: lengths and, where both were walking, angles' distance from what is usual. */
export async function besides(names: readonly [string, string], jobs: readonly [JobDocument, JobDocument], { gait_angles }: Vocabulary, signal: AbortSignal): Promise<HTMLElement> {
  const documents = await Promise.all(jobs.map(({ id }) => getResult<ComparisonDocument>(id, signal)));
  const found = documents.map(({ verdict, methods }) => methods[verdict?.method ?? Object.keys(methods)[0] ?? ""]);
  const lengths = found.map((one) => one?.segment_lengths_mm ?? {});
  const row = (title: string, values: readonly (number | undefined)[], doubt: number | null) => {
    const [one, other] = values;
    const gap = one === undefined || other === undefined ? null : other - one;
    return [cell(title), ...values.map((value) => cell(number(value), value ?? null)),
      cell(signed(gap), gap, gap === null || doubt === null ? undefined : Math.abs(gap) > doubt ? "fair" : "good"), cell(number(doubt), doubt)];
  };
  const known = Object.keys(lengths[0] ?? {}).filter((name) => name in (lengths[1] ?? {}));
  const rows = known.map((name) => {
    const halves = found.map((one) => (one === undefined ? null : lengthInterval(one, name)));
    const doubt = halves.some((half) => half === null) ? null : Math.hypot(...(halves as number[]));
    return row(words(name), lengths.map((all) => all[name]), doubt);
  });
  const scores = gait_angles.flatMap(({ name, title }) => ["l", "r"].flatMap((side) => {
    const values = found.map((one) => one?.clinical?.sides[side]?.gvs_deg[name]);
    return values.some((value) => value === undefined) ? [] : [row(`${title}, ${side === "l" ? "left" : "right"}`, values, null)];
  }));
  const columns = [{ title: "" }, ...names.map((title) => ({ title })), { title: "difference" }, { title: "could be chance up to" }];
  return h("section", null, h("h2", null, `${names[0]} beside ${names[1]}`),
    table({ caption: "Segment lengths, mm", name: "sessions_lengths_mm", columns, rows, note: "Chance: half the 95 % interval of a difference, from both sessions' own." }),
    scores.length > 0 ? table({ caption: "RMS distance of each angle from what is usual, deg", name: "sessions_angles_deg", columns: columns.slice(0, 4), rows: scores.map((one) => one.slice(0, 4)) })
      : h("p", { class: "quiet" }, "Not both sessions have whole strides, so no angles are compared."));
}
