/** What a report holds within itself, and how it answers what its views ask the service for. */

import type { FileEntry, Vocabulary } from "../api/schema.ts";
import { h } from "../ui/dom.ts";

/** As Python writes it, in `scaling_service/report/onefile.py`. */
export interface Held {
  kind: string;
  title: string;
  subtitle: string;
  /** Name of the result's document beside the report. */
  name: string;
  document: unknown;
  /** Name of a file to its content: gzip in base 64. */
  files: Record<string, string>;
  /** Names of files that lie beside the report. */
  beside: string[];
  vocabulary: Partial<Vocabulary>;
  /** Headline, reasons and tables, as readers without JavaScript see them. */
  summary: unknown;
}

/** The id that stands for the report's own result where the service would have a job's. */
export const OWN = "report";

const WORDS: Partial<Vocabulary> = { gait_angles: [], hidden_in_example: [] };

export function held(): Held {
  return JSON.parse(document.getElementById("held")?.textContent ?? "{}") as Held;
}

/** An answer to a path of the service's; 404 where the report has nothing of it. */
export async function answer(report: Held, path: string, asked: RequestInit): Promise<Response> {
  const own = `/v1/jobs/${OWN}`;
  if (path === "/v1/vocabulary") return json({ ...WORDS, ...report.vocabulary });
  if (path === `${own}/summary`) return json(report.summary);
  if (path === `${own}/result`) return json(report.document);
  if (path === `${own}/files`) return json({ items: Object.keys(report.files).map((name): FileEntry => ({ name, size: 0, sha256: "" })) });
  const content = report.files[decodeURIComponent(path.replace(`${own}/files/`, ""))];
  if (content === undefined) return new Response(null, { status: 404, statusText: "not in this report" });
  return new Response(ranged(await unpacked(content), new Headers(asked.headers).get("Range")));
}

const json = (value: unknown): Response => new Response(JSON.stringify(value));

async function unpacked(content: string): Promise<ArrayBuffer> {
  const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/** A stretch of bytes, both ends counted, as HTTP has it. */
function ranged(content: ArrayBuffer, range: string | null): ArrayBuffer {
  const found = /^bytes=(\d+)-(\d+)$/.exec(range ?? "");
  return found === null ? content : content.slice(Number(found[1]), Number(found[2]) + 1);
}

/** The result's document to be saved, and what lies beside the report. */
export function besides({ name, document: content, beside }: Held, save: (name: string, text: string) => void): HTMLElement {
  return h("div", null,
    h("div", { class: "actions" }, h("button", { class: "main", onclick: () => save(name, JSON.stringify(content, null, 1)) }, "The result as JSON")),
    h("p", null, "Every table here can be saved as CSV, every figure as SVG, PNG and CSV. In the folder of this report lie:"),
    h("ul", null, ...beside.map((file) => h("li", null, h("code", null, file)))));
}
