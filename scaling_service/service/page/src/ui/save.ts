/** Files for the person: made here, or fetched with the key that a plain link cannot carry. */

import { currentKey } from "../api/key.ts";
import { getBlob, sendJson } from "../api/http.ts";
import { h } from "./dom.ts";

export function save(name: string, content: Blob): void {
  const address = URL.createObjectURL(content);
  h("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

export function saveText(name: string, text: string, type = "text/csv"): void {
  save(name, new Blob([text], { type: `${type};charset=utf-8` }));
}

/** Download from the service; files go to the disk by themselves, whatever their size. */
export async function download(path: string, name: string): Promise<void> {
  if (currentKey() === null || isFile(path)) h("a", { href: await openable(path), download: name }).click();
  else save(name, await getBlob(path));
}

/** Open a page that the service keeps, such as a report, beside this one. */
export async function open(path: string): Promise<void> {
  const opened = window.open("", "_blank"); // now, for browsers allow it only within the click
  const address = await openable(path);
  if (opened === null) return;
  opened.opener = null;
  opened.location.href = address;
}

const isFile = (path: string): boolean => path.includes("/files");

/** A path that the browser itself can fetch: it carries no key, so with keys a ticket stands in for it. */
async function openable(path: string): Promise<string> {
  return currentKey() === null ? path : (await sendJson<{ path: string }>("/v1/links", { path })).path;
}

/** Rows as comma-separated values (RFC 4180). */
export function csv(rows: readonly (readonly (string | number | null | undefined)[])[]): string {
  return rows.map((row) => row.map(quoted).join(",")).join("\r\n") + "\r\n";
}

function quoted(value: string | number | null | undefined): string {
  const text = value === null || value === undefined || Number.isNaN(value) ? "" : String(value);
  // A spreadsheet would run a text that begins like a formula.
  const safe = typeof value === "string" && /^[=+\-@\t\r]/.test(text) ? `'${text}` : text;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}
