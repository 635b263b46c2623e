// Keeps requests below what the server allows: it closes the connection of who asks too often, and a key that is held
// down asks thirty times a second.

import type { Request } from "./protocol/text.ts";

/** The server allows 20 a second with bursts of 40; some are left for requests with an answer. */
const PER_SECOND = 12;
const BURST = 20;

export class RequestPacer {
  private tokens = BURST;
  private last_ms = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  /** What waits, in order: of each kind the newest, steps added up. */
  private readonly waiting = new Map<Request["do"], Request>();

  constructor(private readonly deliver: (request: Request) => void) {}

  /** Delivers at once, or, where that would be too often, a little later what is then still wanted. */
  send(request: Request, now_ms: number): void {
    this.refill(now_ms);
    if (this.waiting.size === 0 && this.tokens >= 1) {
      this.tokens--;
      this.deliver(request);
      return;
    }
    const before = this.waiting.get(request.do);
    const isSum = request.do === "step" && before?.do === "step";
    this.waiting.delete(request.do);
    this.waiting.set(request.do, isSum ? { do: "step", ticks: before.ticks + request.ticks } : request);
    this.timer ??= setTimeout(() => this.flush(performance.now()), 1000 / PER_SECOND);
  }

  /** Forgets what waits, as when the connection has ended. */
  clear(): void {
    this.waiting.clear();
    clearTimeout(this.timer);
    this.timer = undefined;
  }

  /** Delivers what may be delivered by now. */
  flush(now_ms: number): void {
    this.timer = undefined;
    this.refill(now_ms);
    for (const [kind, request] of this.waiting) {
      if (this.tokens < 1) break;
      this.tokens--;
      this.waiting.delete(kind);
      this.deliver(request);
    }
    if (this.waiting.size > 0) this.timer = setTimeout(() => this.flush(performance.now()), 1000 / PER_SECOND);
  }

  private refill(now_ms: number): void {
    this.tokens = Math.min(BURST, this.tokens + (Math.max(0, now_ms - this.last_ms) / 1000) * PER_SECOND);
    this.last_ms = now_ms;
  }
}
