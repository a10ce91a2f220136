/** What went wrong, in the words of the service: which file, which field, what to do. */
export interface ProblemDetails {
  problem: string;
  file?: string | null;
  field?: string | null;
  remedy?: string | null;
}

export class Problem extends Error implements ProblemDetails {
  readonly problem: string;
  readonly file: string | null;
  readonly field: string | null;
  readonly remedy: string | null;
  readonly status: number;

  constructor(details: ProblemDetails, status = 0) {
    super(details.problem);
    this.problem = details.problem;
    this.file = details.file ?? null;
    this.field = details.field ?? null;
    this.remedy = details.remedy ?? null;
    this.status = status;
  }
}

/** The problem that an answer other than success tells. */
export async function problemOf(answer: Response): Promise<Problem> {
  const body: unknown = await answer.json().catch(() => null);
  if (isProblem(body)) return new Problem(body, answer.status);
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

function isProblem(found: unknown): found is ProblemDetails {
  return typeof found === "object" && found !== null && typeof (found as ProblemDetails).problem === "string";
}
