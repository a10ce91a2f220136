/** The look at a subject's files; one that was made before comes back at once. */

import { resultOf } from "../api/jobs.ts";
import type { JobDocument, MarkerMapDocument, ProofDocument } from "../api/schema.ts";
import type { Place } from "../routes.ts";

export function proofOf(
  subject: string,
  { query }: Place,
  { labels }: MarkerMapDocument,
  changed: (job: JobDocument) => void,
  signal: AbortSignal,
): Promise<{ job: JobDocument; result: ProofDocument }> {
  const axes = Object.fromEntries(["up", "forward"].flatMap((name) => (query.has(name) ? [[name, query.get(name)]] : [])));
  const request = { subject, labels, ...(Object.keys(axes).length > 0 ? { settings: axes } : {}) };
  return resultOf<ProofDocument>("proofs", request, changed, signal);
}
