// How a picture lies on the screen. A pixel's coordinates are those of its middle: (0, 0) is the centre of the first.

import type { Pixel } from "./document.ts";

const MOST_SCALE = 64;

export class Zoom {
  /** Screen lengths of a pixel. */
  scale = 1;
  private x = 0;
  private y = 0;
  private least = 0.01;

  constructor(
    private readonly width_px: number,
    private readonly height_px: number,
  ) {}

  /** All of the picture in the middle of the screen. */
  fit(width: number, height: number): void {
    this.scale = Math.min(width / this.width_px, height / this.height_px);
    this.least = this.scale / 2;
    this.x = (width - this.scale * this.width_px) / 2;
    this.y = (height - this.scale * this.height_px) / 2;
  }

  toScreen([x, y]: Pixel): [number, number] {
    return [this.x + (x + 0.5) * this.scale, this.y + (y + 0.5) * this.scale];
  }

  toPixel(x: number, y: number): [number, number] {
    return [(x - this.x) / this.scale - 0.5, (y - this.y) / this.scale - 0.5];
  }

  /** Nearer by a factor, about a place of the screen that stays where it is. */
  by(factor: number, x: number, y: number): void {
    const next = Math.min(MOST_SCALE, Math.max(this.least, this.scale * factor));
    const real = next / this.scale;
    this.x = x - (x - this.x) * real;
    this.y = y - (y - this.y) * real;
    this.scale = next;
  }

  pan(dx: number, dy: number): void {
    this.x += dx;
    this.y += dy;
  }

  /** The pixel in the middle of a screen of this size. */
  lookAt(at: Pixel, width: number, height: number): void {
    const [x, y] = this.toScreen(at);
    this.pan(width / 2 - x, height / 2 - y);
  }

  contains([x, y]: Pixel): boolean {
    return x >= -0.5 && y >= -0.5 && x <= this.width_px - 0.5 && y <= this.height_px - 0.5;
  }
}
