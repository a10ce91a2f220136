/** Taking a result away: one zip, single files, and the commands that get it again. */

import { filePath, listFiles } from "../api/jobs.ts";
import { currentKey } from "../api/key.ts";
import { send, sendJson } from "../api/http.ts";
import { ROUTES, type FileEntry, type Link } from "../api/schema.ts";
import { select } from "../ui/choice.ts";
import { fill, h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { download, open } from "../ui/save.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { moment, plural, size } from "../ui/words.ts";
import type { Finished } from "./result.ts";
import { reuse } from "./reuse.ts";

export async function takeAway(found: Finished, place: HTMLElement): Promise<void> {
  const { job, request, signal } = found;
  const failed = h("div");
  place.append(failed);
  const files = await listFiles(job.id);
  if (signal.aborted) return;
  const report = files.find(({ name }) => name === "report.html");
  const all = files.reduce((sum, file) => sum + file.size, 0);
  place.append(
    h(
      "div",
      { class: "actions" },
      h("button", { class: "main", onclick: () => void guarded(failed, () => download(`/v1/jobs/${job.id}/files.zip`, `${job.kind}-${job.id.slice(0, 8)}.zip`)) },
        `Everything as one zip (${size(all)})`),
      h("button", { onclick: () => void guarded(failed, () => download(`/v1/jobs/${job.id}/result`, `${job.kind}.json`)) }, "The result as JSON"),
      report !== undefined &&
        h("button", { onclick: () => void guarded(failed, () => open(filePath(job.id, report.name))) }, "The report"),
      currentKey() === null
        ? h("a", { class: "button", href: `/v1/jobs/${job.id}`, target: "_blank", rel: "noopener" }, "The same in the API")
        : h("code", null, `GET ${location.origin}/v1/jobs/${job.id}`),
    ),
    report === undefined ? "" : sharing(filePath(job.id, report.name), failed),
    ...[await reuse(found, files)].filter((section) => section !== null),
    ...commands(job.kind, request),
    table({
      caption: "Files",
      name: "files",
      columns: [{ title: "file" }, { title: "size" }, { title: "SHA-256" }],
      rows: files.map((file) => row(job.id, file, failed)),
      filter: true,
      note: "How the result was made (inputs, settings, code, machine) stands in origin: /v1/jobs/ID/origin.",
    }),
  );
}

const DAY_S = 86_400;
const LIFETIMES = [1, 7, 30].map((days) => ({ value: String(days * DAY_S), text: plural(days, "day") }));

/** A link to the report that works without a key until it ends, for a colleague who only reads. */
function sharing(path: string, failed: HTMLElement): HTMLElement {
  let lifetime_s = 7 * DAY_S;
  const made = h("p", { role: "status" });
  const make = async (): Promise<void> => {
    const link = await sendJson<Link>("/v1/links", { path, lifetime_s });
    const address = new URL(link.path, location.origin).href;
    fill(made, h("code", null, address), " ", h("button", { class: "small", onclick: () => void navigator.clipboard.writeText(address) }, "Copy"), h("span", { class: "quiet" }, ` until ${moment(link.until)}`));
  };
  const end = async (): Promise<void> => {
    await send("/v1/links", { method: "DELETE" });
    fill(made, "No link that you made opens anything any more.");
  };
  return h("section", null, h("h2", null, "For a colleague"),
    h("p", null, "A link to the report, to be read only. Whoever has it needs no key until it ends."),
    h("div", { class: "actions" }, select("works for", LIFETIMES, String(lifetime_s), (value) => void (lifetime_s = Number(value))),
      h("button", { onclick: () => void guarded(failed, make) }, "Make a link"), h("button", { class: "small", onclick: () => void guarded(failed, end) }, "End all links")),
    made);
}

function row(job: string, { name, size: bytes, sha256 }: FileEntry, failed: HTMLElement): Cell[] {
  const get = (): void => void guarded(failed, () => download(filePath(job, name), name.slice(name.lastIndexOf("/") + 1)));
  return [
    { text: name, node: h("button", { class: "linked", onclick: get }, name) },
    cell(size(bytes), bytes),
    { text: sha256, node: h("code", { title: sha256 }, sha256.slice(0, 12)) },
  ];
}

function commands(kind: string, request: Record<string, unknown>): HTMLElement[] {
  const route = ROUTES[kind];
  if (route === undefined) return [];
  return [
    h("h2", null, "The same from a shell"),
    h("pre", { tabindex: 0 }, curlLines(route, request)),
    h("h2", null, "The same from Python"),
    h("pre", { tabindex: 0 }, pythonLines(route, request)),
  ];
}

function curlLines(route: string, request: Record<string, unknown>): string {
  const key = currentKey() === null ? "" : ` -H "Authorization: Bearer $KEY"`;
  const body = JSON.stringify(asked(request), null, 1).replaceAll("'", "'\\''");
  const api = `${location.origin}/v1`;
  return [
    `job=$(curl -sf${key} ${api}/${route} --json '${body}' | grep -o '"id":"[^"]*"' | cut -d'"' -f4)`,
    `curl -sfN${key} ${api}/jobs/$job/events`,
    `curl -sf${key} ${api}/jobs/$job/result -o result.json`,
    `curl -sf${key} ${api}/jobs/$job/files.zip -o results.zip`,
  ].join("\n");
}

function pythonLines(route: string, request: Record<string, unknown>): string {
  const key = currentKey() === null ? "" : `, key=os.environ["KEY"]`;
  return [
    key === "" ? "" : "import os",
    "from scaling_service.client import Client",
    "",
    `with Client("${location.origin}"${key}) as client:`,
    `    job = client.ask(${asPython(route)}, **${asPython(asked(request))})`,
    "    client.wait(job)",
    "    result = client.result(job)",
    `    client.download(job, "results")`,
  ].join("\n").trimStart();
}

/** Without what is as it is unless given. */
function asked(request: Record<string, unknown>): Record<string, unknown> {
  return Object.fromEntries(Object.entries(request).filter(([, value]) => value !== null));
}

/** A value as Python writes it. */
function asPython(value: unknown): string {
  if (value === null || value === undefined) return "None";
  if (value === true) return "True";
  if (value === false) return "False";
  if (Array.isArray(value)) return `[${value.map(asPython).join(", ")}]`;
  if (typeof value === "object") {
    const pairs = Object.entries(value).map(([name, one]) => `${JSON.stringify(name)}: ${asPython(one)}`);
    return `{${pairs.join(", ")}}`;
  }
  return JSON.stringify(value);
}
