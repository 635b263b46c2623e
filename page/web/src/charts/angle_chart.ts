// Joint angles over time: degrees, flexion positive, a gap where an angle was not observed.

import type { AngleReading } from "../angle_names.ts";
import { Chart, roundStep, type ChartColours } from "./pen.ts";
import type { AngleSeries } from "./series.ts";

/** Seconds that are shown. */
export const CHART_S = 6;
/** Least extent of the axis, degrees: noise of a still joint must not fill it. */
const LEAST_SPAN_DEG = 30;
const LEFT_PX = 34;
const BOTTOM_PX = 16;
/** Colours of lines, which also differ in their dashes. */
export const LINE_COLOURS = ["#e69f00", "#56b4e9", "#1fb58a", "#d98cb8", "#e8702a", "#8f8fe0"] as const;
const DASHES: readonly (readonly number[])[] = [[], [], [], [6, 3], [6, 3], [2, 3]];

export class AngleChart {
  readonly chart = new Chart("angle-chart", "Joint angles over the last seconds, degrees");
  private low = 0;
  private high = 90;

  /** Draws `angles` of `series`, whose columns are in the same order, up to `tick`. */
  draw(series: AngleSeries, angles: readonly AngleReading[], tick: number, rate_hz: number, colours: ChartColours): void {
    const pen = this.chart.begin();
    if (pen === null) return;
    const { width, height } = this.chart;
    const from = tick - CHART_S * rate_hz;
    this.fit(series, angles, from);
    const x = (t: number): number => LEFT_PX + ((t - from) / (tick - from)) * (width - LEFT_PX - 4);
    const y = (deg: number): number => 6 + ((this.high - deg) / (this.high - this.low)) * (height - BOTTOM_PX - 10);
    this.drawAxes(pen, y, colours);
    angles.forEach((angle, a) => {
      pen.strokeStyle = LINE_COLOURS[a % LINE_COLOURS.length] ?? colours.text;
      pen.setLineDash([...(DASHES[a % DASHES.length] ?? [])]);
      pen.lineWidth = 1.6;
      pen.beginPath();
      let isDown = false;
      for (let i = 0; i < series.length; i++) {
        const t = series.tickAt(i);
        if (t < from || t > tick) continue;
        const deg = series.valueAt(i, a) * angle.degreesPerRadian;
        const isGap = !Number.isFinite(deg) || (i > 0 && t - series.tickAt(i - 1) > 0.25 * rate_hz);
        if (Number.isFinite(deg)) {
          if (isDown && !isGap) pen.lineTo(x(t), y(deg));
          else pen.moveTo(x(t), y(deg));
        }
        isDown = Number.isFinite(deg);
      }
      pen.stroke();
    });
    pen.setLineDash([]);
  }

  /** Fits the axis at once to what is larger, and slowly to what is smaller: it must not dance. */
  private fit(series: AngleSeries, angles: readonly AngleReading[], from: number): void {
    let low = Infinity;
    let high = -Infinity;
    for (let i = 0; i < series.length; i++) {
      if (series.tickAt(i) < from) continue;
      for (let a = 0; a < angles.length; a++) {
        const deg = series.valueAt(i, a) * (angles[a]?.degreesPerRadian ?? NaN);
        if (!Number.isFinite(deg)) continue;
        low = Math.min(low, deg);
        high = Math.max(high, deg);
      }
    }
    if (low > high) [low, high] = [0, 90];
    const missing = Math.max(0, LEAST_SPAN_DEG - (high - low)) / 2;
    const [least, most] = [Math.floor((low - missing) / 10) * 10, Math.ceil((high + missing) / 10) * 10];
    this.low = least < this.low ? least : this.low + (least - this.low) * 0.05;
    this.high = most > this.high ? most : this.high + (most - this.high) * 0.05;
  }

  private drawAxes(pen: CanvasRenderingContext2D, y: (deg: number) => number, colours: ChartColours): void {
    const { width, height } = this.chart;
    const step = roundStep(this.high - this.low, 5);
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.lineWidth = 1;
    for (let deg = Math.ceil(this.low / step) * step; deg <= this.high; deg += step) {
      pen.strokeStyle = deg === 0 ? colours.faint : colours.line;
      pen.beginPath();
      pen.moveTo(LEFT_PX, Math.round(y(deg)) + 0.5);
      pen.lineTo(width - 4, Math.round(y(deg)) + 0.5);
      pen.stroke();
      pen.fillStyle = colours.faint;
      pen.fillText(`${deg}°`, LEFT_PX - 5, y(deg));
    }
    pen.textBaseline = "bottom";
    pen.textAlign = "left";
    pen.fillText(`−${CHART_S} s`, LEFT_PX, height);
    pen.textAlign = "right";
    pen.fillText("0 s", width - 4, height);
  }
}
