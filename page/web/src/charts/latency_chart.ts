// From the picture to the pose: P50 and P99 over the last minutes, and how the time is spent now.

import type { StageTime } from "../protocol/status.ts";
import { Chart, roundStep, type ChartColours } from "./pen.ts";

/** Statuses that are kept, one a second: three minutes. */
const KEPT = 180;
const LEFT_PX = 44;
const BOTTOM_PX = 16;
/** Height of a label. */
const LABEL_PX = 13;
const P50_COLOUR = "#56b4e9";
const P99_COLOUR = "#e69f00";

export const WHOLE = "capture_to_pose";
/** Parts of the whole, in the order in which they happen. */
export const PARTS = ["capture_to_send", "link", "fusion"] as const;

export class LatencyChart {
  readonly chart = new Chart("latency-chart", "Delay from capture to pose over the last three minutes, P50 and P99");
  private readonly p50_us: number[] = [];
  private readonly p99_us: number[] = [];

  push(stages: readonly StageTime[]): void {
    const whole = stages.find((stage) => stage.stage === WHOLE);
    this.p50_us.push(whole?.p50_us ?? NaN);
    this.p99_us.push(whole?.p99_us ?? NaN);
    if (this.p50_us.length > KEPT) {
      this.p50_us.shift();
      this.p99_us.shift();
    }
  }

  draw(colours: ChartColours): void {
    const pen = this.chart.begin();
    if (pen === null) return;
    const { width, height } = this.chart;
    const most_us = Math.max(10_000, ...this.p99_us.filter(Number.isFinite), ...this.p50_us.filter(Number.isFinite));
    const step_us = roundStep(most_us, 4);
    const top_us = Math.ceil(most_us / step_us) * step_us;
    const y = (us: number): number => 6 + (1 - us / top_us) * (height - BOTTOM_PX - 8);
    const x = (i: number): number => LEFT_PX + ((KEPT - this.p50_us.length + i) / (KEPT - 1)) * (width - LEFT_PX - 4);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (let us = 0; us <= top_us; us += step_us) {
      pen.strokeStyle = colours.line;
      pen.beginPath();
      pen.moveTo(LEFT_PX, Math.round(y(us)) + 0.5);
      pen.lineTo(width - 4, Math.round(y(us)) + 0.5);
      pen.stroke();
      pen.fillStyle = colours.faint;
      pen.fillText(delayText(us, top_us), LEFT_PX - 5, y(us));
    }
    pen.textBaseline = "bottom";
    pen.textAlign = "left";
    pen.fillText("−3 min", LEFT_PX, height);
    pen.textAlign = "right";
    pen.fillText("now", width - 4, height);
    drawLine(pen, this.p99_us, P99_COLOUR, x, y);
    drawLine(pen, this.p50_us, P50_COLOUR, x, y);
    const [p99_us, p50_us] = [this.p99_us.at(-1) ?? NaN, this.p50_us.at(-1) ?? NaN];
    const [p99_y, p50_y] = labelPlaces(y(p99_us), y(p50_us), height - BOTTOM_PX);
    pen.textAlign = "right";
    pen.textBaseline = "bottom";
    for (const [text, at, colour] of [["P99", p99_y, P99_COLOUR], ["P50", p50_y, P50_COLOUR]] as const) {
      if (!Number.isFinite(at)) continue;
      pen.fillStyle = colour;
      pen.fillText(text, width - 6, at);
    }
  }
}

/**
 * Where the labels of two lines stand, by their lower edge: above their line, and where the lines are close the lower one below
 * its line, so that neither label lies on the other. Inside the chart, from 0 to `bottom`. P99 is never below P50.
 */
export function labelPlaces(p99_y: number, p50_y: number, bottom: number): [number, number] {
  const upper = Math.max(LABEL_PX, p99_y - 2);
  const alone = p50_y - 2;
  if (!(alone - upper < LABEL_PX)) return [upper, alone];
  const lower = Math.max(p50_y + 2 + LABEL_PX, upper + LABEL_PX);
  return lower <= bottom ? [upper, lower] : [bottom - LABEL_PX, bottom];
}

/** A delay at the axis: in seconds where the axis reaches one, so that it has room. */
export function delayText(us: number, top_us: number): string {
  return top_us < 1e6 ? `${us / 1e3} ms` : `${us / 1e6} s`;
}

function drawLine(
  pen: CanvasRenderingContext2D,
  us: readonly number[],
  colour: string,
  x: (i: number) => number,
  y: (us: number) => number,
): void {
  pen.strokeStyle = colour;
  pen.lineWidth = 1.6;
  pen.beginPath();
  let isDown = false;
  us.forEach((value, i) => {
    if (!Number.isFinite(value)) isDown = false;
    else if (isDown) pen.lineTo(x(i), y(value));
    else {
      pen.moveTo(x(i), y(value));
      isDown = true;
    }
  });
  pen.stroke();
}
