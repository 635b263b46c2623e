// What `farfield calibrate marks` and this page say to each other: docs/page.md, "The page of marks".

import { Fields, numberOf, textOf } from "../protocol/checked.ts";

export type Pixel = readonly [number, number];

export interface LengthBetween {
  readonly between: readonly [string, string];
  readonly length_m: number;
}

/** What was clicked so far: the file, as JSON. Never changed, only replaced. */
export interface Clicked {
  readonly court: string | null;
  readonly size_m: readonly number[] | null;
  readonly click_sigma_px: number | null;
  readonly place_sigma_m: number | null;
  readonly floor: readonly string[];
  readonly places: Readonly<Record<string, readonly number[]>>;
  readonly lengths: readonly LengthBetween[];
  readonly camera: Readonly<Record<string, Readonly<Record<string, readonly Pixel[]>>>>;
}

export interface CourtMark {
  readonly name: string;
  readonly position_m: readonly number[];
}

export interface CourtLine {
  readonly name: string;
  readonly points_m: readonly (readonly number[])[];
}

export interface Court {
  readonly name: string;
  readonly rules: string;
  readonly size_m: readonly number[];
  readonly marks: readonly CourtMark[];
  readonly lines: readonly CourtLine[];
}

export interface PictureOfCamera {
  readonly name: string;
  readonly picture: string;
  readonly size_px: readonly number[];
  readonly hasLens: boolean;
}

export type FitState = "fits" | "contradicts" | "too_few" | "no_lens" | "fails";

export interface Residual {
  readonly name: string;
  readonly index: number;
  readonly px: number;
  readonly m: number;
  readonly isOutlier: boolean;
}

/** Where a camera stands by its own marks, as far as they say. */
export interface Fit {
  readonly camera: string;
  readonly state: FitState;
  readonly text: string;
  readonly warnings: readonly string[];
  readonly center_m: readonly number[] | null;
  readonly residuals: readonly Residual[];
  readonly lines: readonly { readonly name: string; readonly pieces: readonly (readonly Pixel[])[] }[];
  readonly marks: ReadonlyMap<string, Pixel>;
}

/** What a change comes to. */
export interface State {
  readonly revision: number;
  readonly clicked: Clicked;
  /** Why `--marks` would refuse the file as it is. */
  readonly problem: string | null;
  readonly fits: readonly Fit[];
}

export interface MarksDocument {
  readonly file: string;
  readonly court: Court | null;
  readonly cameras: readonly PictureOfCamera[];
  readonly state: State;
}

const pixelOf = (value: unknown, path: string): Pixel => {
  const list = Array.isArray(value) ? value : [];
  return [numberOf(list[0], `${path}[0]`), numberOf(list[1], `${path}[1]`)];
};

const numbersOf = (value: unknown, path: string): number[] =>
  (Array.isArray(value) ? value : [value]).map((one, i) => numberOf(one, `${path}[${i}]`));

function readClicked(fields: Fields): Clicked {
  // Whatever a name is, it becomes no more than a name.
  const given = fields.object("places");
  const places = Object.fromEntries(given.names().map((name) => [name, given.numbers(name, 3)]));
  const cameras = fields.object("camera");
  const clicksOf = (own: Fields): Record<string, readonly Pixel[]> =>
    Object.fromEntries(own.names().map((mark) => [mark, own.list(mark, pixelOf)]));
  const camera = Object.fromEntries(cameras.names().map((name) => [name, clicksOf(cameras.object(name))]));
  return {
    court: fields.textOrNull("court"),
    size_m: fields.numbersOrNull("size_m", 2),
    click_sigma_px: fields.numberOrNull("click_sigma_px"),
    place_sigma_m: fields.numberOrNull("place_sigma_m"),
    floor: fields.list("floor", textOf),
    places,
    lengths: fields.list("lengths", (value, path) => {
      const length = Fields.of(value, path);
      const [a = "", b = ""] = length.list("between", textOf);
      return { between: [a, b], length_m: length.number("length_m") };
    }),
    camera,
  };
}

function readFit(value: unknown, path: string): Fit {
  const fields = Fields.of(value, path);
  return {
    camera: fields.text("camera"),
    state: fields.word("state", ["fits", "contradicts", "too_few", "no_lens", "fails"]),
    text: fields.text("text"),
    warnings: fields.list("warnings", textOf),
    center_m: fields.numbersOrNull("center_m", 3),
    residuals: fields.list("residuals", (one, at) => {
      const residual = Fields.of(one, at);
      return {
        name: residual.text("name"),
        index: residual.whole("index"),
        px: residual.number("px"),
        m: residual.number("m"),
        isOutlier: residual.flag("is_outlier"),
      };
    }),
    lines: fields.list("lines", (one, at) => {
      const line = Fields.of(one, at);
      const piece = (points: unknown, where: string): Pixel[] =>
        (Array.isArray(points) ? points : []).map((point, i) => pixelOf(point, `${where}[${i}]`));
      return { name: line.text("name"), pieces: line.list("pieces", piece) };
    }),
    marks: new Map(
      fields.list("marks", (one, at): [string, Pixel] => {
        const mark = Fields.of(one, at);
        const [x = 0, y = 0] = mark.numbers("px", 2);
        return [mark.text("name"), [x, y]];
      }),
    ),
  };
}

export function readState(value: unknown): State {
  const fields = Fields.of(value, "state");
  return {
    revision: fields.whole("revision"),
    clicked: readClicked(fields.object("clicked")),
    problem: fields.textOrNull("problem"),
    fits: fields.list("fits", readFit),
  };
}

export function readDocument(value: unknown): MarksDocument {
  const fields = Fields.of(value, "marks");
  const court = fields.objectOrNull("court");
  return {
    file: fields.text("file"),
    court:
      court === null
        ? null
        : {
            name: court.text("name"),
            rules: court.text("rules"),
            size_m: court.numbers("size_m", 2),
            marks: court.list("marks", (one, at) => {
              const mark = Fields.of(one, at);
              return { name: mark.text("name"), position_m: mark.numbers("position_m", 3) };
            }),
            lines: court.list("lines", (one, at) => {
              const line = Fields.of(one, at);
              return { name: line.text("name"), points_m: line.list("points_m", numbersOf) };
            }),
          },
    cameras: fields.list("cameras", (one, at) => {
      const camera = Fields.of(one, at);
      return {
        name: camera.text("name"),
        picture: camera.text("picture"),
        size_px: camera.numbers("size_px", 2),
        hasLens: camera.flag("has_lens"),
      };
    }),
    state: readState(fields.object("state").raw),
  };
}
