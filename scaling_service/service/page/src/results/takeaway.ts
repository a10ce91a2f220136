/** Taking a result away: one zip, single files, and the commands that get it again. */

import { filePath, listFiles } from "../api/jobs.ts";
import { currentKey } from "../api/key.ts";
import { ROUTES, type FileEntry } from "../api/schema.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";
import { download, open } from "../ui/save.ts";
import { cell, table, type Cell } from "../ui/table.ts";
import { size } from "../ui/words.ts";
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
    ...[reuse(found, files)].filter((section) => section !== null),
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
