/** A cohort that was dropped: a table of subject files, or folders with one each. */

import { Problem } from "../api/problem.ts";
import { folderOf, type Entry } from "./entries.ts";
import { joined, sortedOut, type Intake } from "./subjectfile.ts";

export interface Cohort {
  members: Intake[];
  /** Subject to further columns of the table. */
  groups: Record<string, Record<string, string>>;
}

let kept: Entry[] | null = null;

/** Keep what was dropped elsewhere for the view of the cohort. */
export function keepForCohort(entries: Entry[]): void {
  kept = entries;
}

/** What was kept, once. */
export function takeKept(): Entry[] | null {
  const found = kept;
  kept = null;
  return found;
}

/** The members of a cohort and their groups.
 *
 * @throws Problem where a row of the table names no file that was dropped.
 */
export async function cohortOf(entries: readonly Entry[]): Promise<Cohort> {
  const members = (await sortedOut(entries)).filter(({ document }) => document !== null);
  const table = await tableOf(entries);
  if (table === null) return { members, groups: {} };
  const chosen: Intake[] = [];
  const groups: Cohort["groups"] = {};
  for (const row of table.rows) {
    const path = joined(folderOf(table.path), row.subject ?? "");
    const member = members.find((one) => one.path === path);
    const id = member?.document?.subject.id;
    if (member === undefined || id === undefined) {
      throw new Problem({ file: table.path, field: "subject", problem: `'${row.subject}' is not among the dropped files`,
        remedy: "Drop the folder that holds the table and all subject files" });
    }
    const { subject: _, ...labels } = row;
    chosen.push(member);
    if (Object.keys(labels).length > 0) groups[id] = labels;
  }
  return { members: chosen, groups };
}

interface Table {
  path: string;
  rows: Record<string, string>[];
}

async function tableOf(entries: readonly Entry[]): Promise<Table | null> {
  for (const { path, file } of entries) {
    if (!/\.csv$/i.test(path)) continue;
    const [head, ...rows] = parsedCsv(await file.text());
    if (head?.includes("subject") === true) {
      return { path, rows: rows.map((row) => Object.fromEntries(head.map((name, k) => [name, row[k] ?? ""]))) };
    }
  }
  return null;
}

/** Rows of comma-separated values (RFC 4180); empty lines are left out. */
function parsedCsv(text: string): string[][] {
  const cells = /("(?:[^"]|"")*"|[^,\r\n]*)(,|\r?\n|$)/gy;
  const rows: string[][] = [];
  let row: string[] = [];
  const content = text.replace(/^\uFEFF/, "");
  while (cells.lastIndex < content.length) {
    const match = cells.exec(content);
    if (match === null) break;
    const [, raw = "", end] = match;
    row.push(raw.startsWith('"') ? raw.slice(1, -1).replaceAll('""', '"') : raw.trim());
    if (end !== ",") {
      if (row.some((value) => value !== "")) rows.push(row);
      row = [];
    }
  }
  return rows;
}
