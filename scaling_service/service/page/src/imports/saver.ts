/** Keeps a draft in the service: a moment after each change, and at once where the page is left. */

import type { SubjectDocument } from "../api/schema.ts";
import { putSubject } from "../api/subjects.ts";
import { asProblem } from "../api/problem.ts";
import { leave } from "../ui/flash.ts";
import { h } from "../ui/dom.ts";
import { guarded } from "../ui/problem.ts";

const PAUSE_MS = 700;

export class Saver {
  readonly status = h("span", { class: "quiet", role: "status" });
  readonly failed = h("div");
  private timer = 0;
  private dirty = false;

  /**
   * @param draft what is to be kept.
   * @param saved called when it was.
   */
  constructor(
    private readonly draft: () => SubjectDocument,
    private readonly saved: () => Promise<void>,
    private readonly signal: AbortSignal,
  ) {
    signal.addEventListener("abort", () => {
      clearTimeout(this.timer);
      if (this.dirty) this.put().catch((error: unknown) => leave(`The last change could not be saved: ${asProblem(error).problem}`));
    });
  }

  /** Something has changed. */
  touch(): void {
    this.dirty = true;
    this.status.textContent = "Saving …";
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.flush(), PAUSE_MS);
  }

  /** Keep it now. */
  flush(): Promise<void> {
    clearTimeout(this.timer);
    return guarded(this.failed, async () => {
      try {
        await this.put();
        this.status.textContent = "Saved; looking again …";
        await this.saved();
        if (!this.dirty && !this.signal.aborted) this.status.textContent = "Saved.";
      } catch (error) {
        this.status.textContent = "Not saved.";
        throw error;
      }
    });
  }

  private async put(): Promise<void> {
    this.dirty = false;
    await putSubject(this.draft());
  }
}
