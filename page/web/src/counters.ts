// What the page knows of itself, for tests and for who wonders whether it is slow: `window.farfield` in the console.

const KEPT = 240;

export class Counters {
  private readonly drawn_ms = new Float64Array(KEPT);
  private readonly ended_ms = new Float64Array(KEPT);
  frames = 0;
  ticks = 0;
  bytes = 0;

  frame(start_ms: number, end_ms: number): void {
    this.drawn_ms[this.frames % KEPT] = end_ms - start_ms;
    this.ended_ms[this.frames % KEPT] = end_ms;
    this.frames++;
  }

  /** JavaScript of a frame, median of the last ones, milliseconds. */
  get frameMedian_ms(): number {
    return this.quantile(0.5);
  }

  get frameP99_ms(): number {
    return this.quantile(0.99);
  }

  /** Frames per second over the last ones. */
  get framesPerSecond(): number {
    const n = Math.min(this.frames, KEPT);
    if (n < 2) return 0;
    const newest = this.ended_ms[(this.frames - 1) % KEPT] ?? 0;
    const oldest = this.ended_ms[(this.frames - n) % KEPT] ?? 0;
    return ((n - 1) * 1000) / (newest - oldest);
  }

  private quantile(share: number): number {
    const n = Math.min(this.frames, KEPT);
    if (n === 0) return NaN;
    const sorted = this.drawn_ms.slice(0, n).sort();
    return sorted[Math.min(n - 1, Math.floor(share * n))] ?? NaN;
  }
}
