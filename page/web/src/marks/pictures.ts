// The pictures that were looked at last: going back to one is at once, and not all are in memory.

/** What is large, and given back by hand. */
interface Closing {
  close(): void;
}

export class LastPictures<T extends Closing> {
  private readonly kept = new Map<number, Promise<T>>();

  constructor(
    private readonly load: (number: number) => Promise<T>,
    private readonly most = 3,
  ) {}

  /** A picture, until so many others were asked for. */
  get(number: number): Promise<T> {
    const picture = this.kept.get(number) ?? this.load(number);
    this.kept.delete(number);
    this.kept.set(number, picture);
    // One that did not come is asked for again.
    picture.catch(() => this.kept.get(number) === picture && this.kept.delete(number));
    for (const [old, one] of this.kept) {
      if (this.kept.size <= this.most) break;
      this.kept.delete(old);
      one.then((it) => it.close(), () => undefined);
    }
    return picture;
  }
}
