/** Deep links: where one is in the page stands after `#/`, and can be kept, sent and opened again. */

export interface Place {
  parts: string[];
  query: URLSearchParams;
}

/** `#/jobs/1f?trial=walk` to its parts and its query. */
export function parsed(hash: string): Place {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split("?");
  const parts = path.split("/").filter((part) => part !== "").map(decoded);
  return { parts, query: new URLSearchParams(query) };
}

function decoded(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/** The link to a place. */
export function link(parts: readonly string[], query: Record<string, string> = {}): string {
  const search = new URLSearchParams(query).toString();
  return `#/${parts.map(encodeURIComponent).join("/")}${search === "" ? "" : `?${search}`}`;
}

export const toSubject = (id: string, tab: "import" | "run" | "report" = "import"): string => link(["subjects", id, tab]);

export const toJob = (id: string, ...rest: string[]): string => link(["jobs", id, ...rest]);

/** Note something in the address without leaving the place. */
export function note(values: Record<string, string | null>): void {
  const { parts, query } = parsed(location.hash);
  for (const [name, value] of Object.entries(values)) {
    if (value === null) query.delete(name);
    else query.set(name, value);
  }
  history.replaceState(null, "", link(parts, Object.fromEntries(query)));
}

/** Show the present place anew. */
export const again = (): boolean => dispatchEvent(new HashChangeEvent("hashchange"));
