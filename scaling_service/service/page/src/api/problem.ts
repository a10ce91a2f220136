/** What went wrong, in the words of the service: which file, which field, what to do. */
export interface Told {
  problem: string;
  file?: string | null;
  field?: string | null;
  remedy?: string | null;
}

export class Problem extends Error implements Told {
  readonly problem: string;
  readonly file: string | null;
  readonly field: string | null;
  readonly remedy: string | null;
  readonly status: number;

  constructor(told: Told, status = 0) {
    super(told.problem);
    this.problem = told.problem;
    this.file = told.file ?? null;
    this.field = told.field ?? null;
    this.remedy = told.remedy ?? null;
    this.status = status;
  }
}

/** The problem that an answer other than success tells. */
export async function problemOf(answer: Response): Promise<Problem> {
  const told: unknown = await answer.json().catch(() => null);
  if (isTold(told)) return new Problem(told, answer.status);
  return new Problem(
    { problem: `The service answered ${answer.status} ${answer.statusText}`.trim(), remedy: "Look at its log" },
    answer.status,
  );
}

/** Any error as a problem: a defect of the page says that it is one. */
export function asProblem(error: unknown): Problem {
  if (error instanceof Problem) return error;
  return new Problem({ problem: `The page has a defect: ${String(error)}`, remedy: "Load it again, and report this" });
}

export function isAbort(error: unknown): boolean {
  return error instanceof DOMException && error.name === "AbortError";
}

function isTold(found: unknown): found is Told {
  return typeof found === "object" && found !== null && typeof (found as Told).problem === "string";
}
