// Every change goes to the file at once: one request at a time, and of what waits the newest alone.

import { isSame } from "./clicked.ts";
import { readState, type Clicked, type State } from "./document.ts";

export type Saved = { kind: "saved" } | { kind: "saving" } | { kind: "failed"; reason: string };

/** Ours as it was clicked; ours, with what cameras have that are not shown here; somebody else's, in the place of ours. */
export type Whose = "ours" | "merged" | "foreign";

export interface SaverAnswers {
  saved(saved: Saved): void;
  /** What the change comes to, and whose that is. */
  state(state: State, whose: Whose): void;
  /** The change cannot be in the file: what was clicked before it, and is in the file, and why. */
  refused(accepted: Clicked, reason: string): void;
}

/** Says a change, and what the server answers: the status, and the body. */
export type Send = (body: string) => Promise<{ status: number; text: string }>;

/** What came of a request: it is dealt with; it would be the same again; it may be another time. */
type Outcome = { kind: "done" } | { kind: "stuck" | "later"; reason: string };

const RETRY_MS = 2000;
const AWAY = "the command does not answer: is it still running?";

export class Saver {
  /** The newest that is not known to be in the file. */
  private unsaved: Clicked | null = null;
  /** What was sent and may be in the file, although no answer said so. */
  private unanswered: Clicked[] = [];
  private isBusy = false;
  private hasFailed = false;
  private isRetryDue = false;

  constructor(
    private revision: number,
    /** What is in the file. */
    private accepted: Clicked,
    private readonly send: Send,
    private readonly answers: SaverAnswers,
    private readonly later: (act: () => void, ms: number) => void = (act, ms) => void setTimeout(act, ms),
  ) {}

  /** All is in the file. */
  get isDone(): boolean {
    return this.unsaved === null;
  }

  save(clicked: Clicked): void {
    this.unsaved = clicked;
    if (!this.isBusy) void this.go();
  }

  private async go(): Promise<void> {
    const clicked = this.unsaved;
    if (clicked === null || this.isBusy) return;
    this.isBusy = true;
    // What is tried again every two seconds is not announced each time.
    if (!this.hasFailed) this.answers.saved({ kind: "saving" });
    const outcome = await this.once(clicked).catch((): Outcome => ({ kind: "later", reason: AWAY }));
    this.isBusy = false;
    this.hasFailed = outcome.kind !== "done";
    if (outcome.kind !== "done") {
      this.answers.saved({ kind: "failed", reason: outcome.reason });
      if (outcome.kind === "later") this.retry();
      else if (this.unsaved !== clicked) void this.go();
    } else if (this.unsaved === null) this.answers.saved({ kind: "saved" });
    else void this.go();
  }

  private retry(): void {
    if (this.isRetryDue) return;
    this.isRetryDue = true;
    this.later(() => {
      this.isRetryDue = false;
      void this.go();
    }, RETRY_MS);
  }

  private async once(clicked: Clicked): Promise<Outcome> {
    // Before it is sent: the answer may be lost, and the change in the file.
    if (this.unanswered.at(-1) !== clicked) this.unanswered.push(clicked);
    const { status, text } = await this.send(JSON.stringify({ revision: this.revision, clicked }));
    const reason = text.trim() || `the server answers ${status}`;
    if (status === 400 || status === 413) return this.refused(clicked, reason);
    if (status !== 200 && status !== 409) return { kind: status >= 500 ? "later" : "stuck", reason };
    this.answered(readState(JSON.parse(text)), status === 409, clicked);
    return { kind: "done" };
  }

  private answered(state: State, isBehind: boolean, clicked: Clicked): void {
    const sent = isBehind ? [...this.unanswered].reverse() : [clicked];
    const ours = sent.find((one) => isSame(one, state.clicked));
    this.revision = state.revision;
    this.accepted = ours ?? state.clicked;
    this.unanswered = [];
    // What was clicked since is merged in its turn.
    const isNewest = (isBehind ? ours : clicked) === this.unsaved;
    const isForeign = isBehind && ours === undefined;
    if (isForeign || isNewest) this.unsaved = null;
    this.answers.state(state, isForeign ? "foreign" : ours === undefined && isNewest ? "merged" : "ours");
  }

  private refused(clicked: Clicked, reason: string): Outcome {
    this.unanswered = this.unanswered.filter((one) => one !== clicked);
    // What came since may have put it right.
    if (this.unsaved !== clicked) return { kind: "done" };
    this.unsaved = null;
    this.answers.refused(this.accepted, reason);
    return { kind: "done" };
  }
}
