// Values of a few angles over the last ticks, in memory that does not grow.

const CAPACITY = 2048;

export class AngleSeries {
  private readonly ticks = new Float64Array(CAPACITY);
  private readonly values: Float32Array;
  private count = 0;
  private next = 0;

  constructor(readonly width: number) {
    this.values = new Float32Array(CAPACITY * width);
  }

  clear(): void {
    this.count = 0;
    this.next = 0;
  }

  get length(): number {
    return this.count;
  }

  /** The newest tick, NaN before the first. */
  get lastTick(): number {
    return this.count === 0 ? NaN : (this.ticks[this.slot(this.count - 1)] ?? NaN);
  }

  /** Takes the values of a tick; one that is not after the newest begins anew. */
  push(tick: number, value: (angle: number) => number): void {
    if (tick === this.lastTick) return;
    if (tick < this.lastTick) this.clear();
    this.ticks[this.next] = tick;
    for (let a = 0; a < this.width; a++) this.values[this.next * this.width + a] = value(a);
    this.next = (this.next + 1) % CAPACITY;
    this.count = Math.min(CAPACITY, this.count + 1);
  }

  tickAt(i: number): number {
    return this.ticks[this.slot(i)] ?? NaN;
  }

  /** Value of an angle, NaN where it was not observed. */
  valueAt(i: number, angle: number): number {
    return this.values[this.slot(i) * this.width + angle] ?? NaN;
  }

  /** `i` from the oldest, 0. */
  private slot(i: number): number {
    return (this.next - this.count + i + 2 * CAPACITY) % CAPACITY;
  }
}
