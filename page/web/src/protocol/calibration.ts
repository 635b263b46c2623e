// What the server says of the calibration: `/api/calibration`.

import { Fields } from "./checked.ts";

export interface CalibrationSheet {
  readonly file: string;
  /** `null`: it does not say. */
  readonly isOfThis: boolean | null;
  /** Where it is opened; of this server, and until it ends. */
  readonly path: string;
}

export interface Calibration {
  readonly file: string;
  readonly text: string;
  readonly sheet: CalibrationSheet | null;
}

/** A key in a path of this server, and nothing else: it becomes a link. */
const PATH = /^\/calibration\/[0-9a-f]{32}$/;

export function readCalibration(value: unknown): Calibration {
  const fields = Fields.of(value, "calibration");
  const sheet = fields.objectOrNull("sheet");
  const path = sheet?.text("path") ?? "";
  return {
    file: fields.text("file"),
    text: fields.text("text"),
    sheet:
      sheet === null || !PATH.test(path)
        ? null
        : { file: sheet.text("file"), isOfThis: sheet.isNull("is_of_this") ? null : sheet.flag("is_of_this"), path },
  };
}
