// Every change goes to the file at once: one request at a time, and of what waits the newest alone.

import { readState, type Clicked, type State } from "./document.ts";

export type Saved = { kind: "saved" } | { kind: "saving" } | { kind: "failed"; reason: string };

export interface SaverAnswers {
  saved(saved: Saved): void;
  /** What the change comes to; `isForeign`: somebody else's change, in the place of ours. */
  state(state: State, isForeign: boolean): void;
}

/** Says a change, and what the server answers: the status, and the body. */
export type Send = (body: string) => Promise<{ status: number; text: string }>;

const RETRY_MS = 2000;

export class Saver {
  private waiting: Clicked | null = null;
  private isBusy = false;

  constructor(
    private revision: number,
    private readonly send: Send,
    private readonly answers: SaverAnswers,
    private readonly later: (act: () => void, ms: number) => void = (act, ms) => void setTimeout(act, ms),
  ) {}

  get isDone(): boolean {
    return this.waiting === null && !this.isBusy;
  }

  save(clicked: Clicked): void {
    this.waiting = clicked;
    if (!this.isBusy) void this.go();
  }

  private async go(): Promise<void> {
    const clicked = this.waiting;
    if (clicked === null) return;
    this.waiting = null;
    this.isBusy = true;
    this.answers.saved({ kind: "saving" });
    const reason = await this.once(clicked).catch(() => {
      // Nobody is there; the same again in a moment, unless there is something newer.
      this.waiting ??= clicked;
      return "the command does not answer: is it still running?";
    });
    this.isBusy = false;
    if (reason === null && this.waiting === null) this.answers.saved({ kind: "saved" });
    else if (reason === null) void this.go();
    else {
      this.answers.saved({ kind: "failed", reason });
      if (this.waiting !== null) this.later(() => !this.isBusy && void this.go(), RETRY_MS);
    }
  }

  /** `null`: it is in the file. */
  private async once(clicked: Clicked): Promise<string | null> {
    const { status, text } = await this.send(JSON.stringify({ revision: this.revision, clicked }));
    if (status !== 200 && status !== 409) return text.trim() || `the server answers ${status}`;
    const state = readState(JSON.parse(text));
    this.revision = state.revision;
    if (status === 409) this.waiting = null;
    this.answers.state(state, status === 409);
    return null;
  }
}
