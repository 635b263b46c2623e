// A canvas to draw charts on: sized in CSS pixels, sharp on any screen, in the colours of the theme.

export interface ChartColours {
  readonly text: string;
  readonly faint: string;
  readonly line: string;
}

export class Chart {
  readonly canvas = document.createElement("canvas");
  width = 0;
  height = 0;

  constructor(className: string, label: string) {
    this.canvas.className = className;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
  }

  /** A cleared pen in CSS pixels; `null` while the chart is not on the screen. */
  begin(): CanvasRenderingContext2D | null {
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    const pen = this.width > 0 && this.height > 0 ? this.canvas.getContext("2d") : null;
    if (pen === null) return null;
    const ratio = Math.min(2, devicePixelRatio);
    const [w, h] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== w) this.canvas.width = w;
    if (this.canvas.height !== h) this.canvas.height = h;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    pen.font = "11px system-ui, sans-serif";
    return pen;
  }
}

/** The colours of the page's style sheet. */
export function chartColours(): ChartColours {
  const style = getComputedStyle(document.documentElement);
  const of = (name: string): string => style.getPropertyValue(name).trim();
  return { text: of("--text"), faint: of("--faint"), line: of("--line") };
}

/** A step of 1, 2 or 5 times a power of ten that divides `span` into at most `most` parts. */
export function roundStep(span: number, most: number): number {
  const rough = Math.max(1e-9, span) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  for (const factor of [1, 2, 5]) if (factor * power >= rough) return factor * power;
  return 10 * power;
}
