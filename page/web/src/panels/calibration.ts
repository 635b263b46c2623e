// The calibration: its sheet, whether the sheet is of it, and where the cameras stand.

import { element, setClass, setHidden, setText } from "../dom.ts";
import type { Calibration } from "../protocol/calibration.ts";
import type { Camera } from "../protocol/venue.ts";
import type { PageState } from "../state.ts";
import { fixed } from "../units.ts";
import { agreementInWords } from "./agreement.ts";

export class CalibrationPanel {
  readonly root = element("section", { class: "calibration", label: "Calibration" });
  private readonly open = element("a", { class: "sheet-link", attributes: { target: "_blank", rel: "noopener noreferrer" } });
  private readonly name = element("b", { text: "Calibration" });
  private readonly said = element("p", { class: "hint" });
  private readonly agreements: HTMLElement[] = [];

  constructor(private readonly state: PageState) {
    const head = element("tr", {}, ...["camera", "x", "y", "z, m"].map((text) => element("th", { text })), element("th", { class: "words", text: "agreement" }));
    const table = element("table", {}, head);
    for (const camera of state.venue.cameras) {
      const agreement = element("td", { class: "words" });
      this.agreements.push(agreement);
      table.append(element("tr", {}, element("td", { text: camera.name }), ...placeOf(camera), agreement));
    }
    const places = element("details", {}, element("summary", { text: "Where the cameras stand" }), element("div", { class: "wide" }, table));
    this.root.append(element("div", { class: "card-head" }, this.name, this.open), this.said, places);
    setHidden(this.open, true);
  }

  take(calibration: Calibration): void {
    const { sheet } = calibration;
    setText(this.name, calibration.file === "" ? "Calibration" : calibration.file);
    setText(this.said, sheet?.isOfThis === false ? `! ${calibration.text}` : calibration.text);
    setClass(this.said, "doubtful", sheet?.isOfThis === false);
    setHidden(this.open, sheet === null);
    if (sheet === null) return;
    setText(this.open, "Open the sheet");
    this.open.title = `${sheet.file}: how well each camera is known, and how sure a point is where in the field`;
    this.open.href = sheet.path;
  }

  update(): void {
    this.agreements.forEach((cell, i) => {
      const agreement = this.state.status?.cameras.find((camera) => camera.camera === i)?.agreement ?? null;
      setText(cell, agreementInWords(agreement) || (this.state.venue.mode === "live" ? "not told yet" : "not told"));
    });
  }
}

function placeOf(camera: Camera): HTMLElement[] {
  return camera.position_m.map((metres) => element("td", { text: fixed(metres, 2) }));
}
