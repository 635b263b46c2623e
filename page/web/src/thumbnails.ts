// Small pictures of the cameras, where the venue lets pictures leave its edges: asked for once a second while somebody looks
// at the cameras of now. Lines are drawn over them.

import type { Connection } from "./connection.ts";
import { isPast, type PageState } from "./state.ts";

/** How often the server is asked, milliseconds: as often as edges make new ones. */
const EVERY_MS = 1000;
/** A picture of which nothing is heard for so long is not of now, milliseconds. */
const FRESH_MS = 15_000;

interface Shown {
  readonly picture: ImageBitmap;
  readonly tag: string;
  heard_ms: number;
}

export class Thumbnails {
  private readonly shown = new Map<number, Shown>();
  private isAsking = false;
  private asked_ms = -Infinity;

  constructor(
    private readonly state: PageState,
    private readonly connection: Pick<Connection, "thumbnail">,
  ) {}

  /** The picture of a camera, if there is one of now. */
  of(camera: number): ImageBitmap | null {
    return this.shown.get(camera)?.picture ?? null;
  }

  /** Called while somebody looks at the cameras: asks anew where it is time. */
  look(now_ms: number): void {
    const { state } = this;
    if (!state.venue.pictures) return;
    if (isPast(state) || state.connection.kind !== "open") {
      for (const camera of [...this.shown.keys()]) this.forget(camera);
      return;
    }
    for (const [camera, shown] of this.shown) if (now_ms - shown.heard_ms > FRESH_MS) this.forget(camera);
    if (this.isAsking || now_ms - this.asked_ms < EVERY_MS) return;
    this.asked_ms = now_ms;
    this.isAsking = true;
    void this.askAll().finally(() => (this.isAsking = false));
  }

  /** One after the other: pictures shall not take the connections of what is measured. */
  private async askAll(): Promise<void> {
    for (let camera = 0; camera < this.state.venue.cameras.length; camera++) {
      if (isPast(this.state) || this.state.connection.kind !== "open") return;
      await this.ask(camera);
    }
  }

  private async ask(camera: number): Promise<void> {
    const before = this.shown.get(camera);
    try {
      const answer = await this.connection.thumbnail(camera, before?.tag ?? "");
      if (answer === null) return this.forget(camera);
      if (answer !== "same") {
        const picture = await createImageBitmap(answer.picture);
        this.forget(camera);
        this.shown.set(camera, { picture, tag: answer.tag, heard_ms: performance.now() });
      } else if (before !== undefined) {
        before.heard_ms = performance.now();
      }
    } catch {
      // What cannot be had or read now is asked for again; what is old is let go of.
    }
  }

  private forget(camera: number): void {
    this.shown.get(camera)?.picture.close();
    this.shown.delete(camera);
  }
}
