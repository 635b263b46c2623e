// Lines of courts, metres, about the middle of the court; x is the long way. After the rules of each sport's federation.

/** A painted line from one point to another. */
export type Line = readonly [x1: number, y1: number, x2: number, y2: number];

interface Court {
  readonly length_m: number;
  readonly width_m: number;
  readonly lines: readonly Line[];
}

const ARC_STEPS = 24;

function arc(x: number, y: number, radius: number, from_deg: number, to_deg: number): Line[] {
  const lines: Line[] = [];
  for (let i = 0; i < ARC_STEPS; i++) {
    const [a, b] = [i, i + 1].map((k) => ((from_deg + ((to_deg - from_deg) * k) / ARC_STEPS) * Math.PI) / 180);
    const [from = 0, to = 0] = [a, b];
    lines.push([
      x + radius * Math.cos(from),
      y + radius * Math.sin(from),
      x + radius * Math.cos(to),
      y + radius * Math.sin(to),
    ]);
  }
  return lines;
}

function box(x1: number, y1: number, x2: number, y2: number): Line[] {
  return [
    [x1, y1, x2, y1],
    [x2, y1, x2, y2],
    [x2, y2, x1, y2],
    [x1, y2, x1, y1],
  ];
}

/** Lines of one half and their mirror image. */
function bothEnds(lines: readonly Line[]): Line[] {
  return lines.flatMap((line): Line[] => [line, [-line[0], line[1], -line[2], line[3]]]);
}

function court(length_m: number, width_m: number, lines: readonly Line[]): Court {
  return { length_m, width_m, lines: [...box(-length_m / 2, -width_m / 2, length_m / 2, width_m / 2), ...lines] };
}

function halfway(width_m: number): Line {
  return [0, -width_m / 2, 0, width_m / 2];
}

/** Goal areas of indoor football: quarter circles of `radius` about the posts, joined by a straight line. */
function goalArea(length_m: number, radius: number, goal_m: number): Line[] {
  const end = -length_m / 2;
  return bothEnds([
    ...arc(end, goal_m / 2, radius, 0, 90),
    ...arc(end, -goal_m / 2, radius, -90, 0),
    [end + radius, -goal_m / 2, end + radius, goal_m / 2],
  ]);
}

const COURTS: Readonly<Record<string, Court>> = {
  // ITF: 23.77 x 10.97 with the alleys; singles 8.23; service lines 6.40 from the net.
  tennis: court(23.77, 10.97, [
    [-11.885, -4.115, 11.885, -4.115],
    [-11.885, 4.115, 11.885, 4.115],
    [-6.4, -4.115, -6.4, 4.115],
    [6.4, -4.115, 6.4, 4.115],
    [-6.4, 0, 6.4, 0],
    halfway(10.97),
  ]),
  // FIBA: 28 x 15; restricted area 5.8 x 4.9; three-point line 6.75 from the basket, which is 1.575 from the end line.
  basketball: court(28, 15, [
    halfway(15),
    ...arc(0, 0, 1.8, 0, 360),
    ...bothEnds([
      ...box(-14, -2.45, -8.2, 2.45),
      ...arc(-8.2, 0, 1.8, -90, 90),
      ...arc(-12.425, 0, 6.75, -78.1, 78.1),
      [-14, -6.6, -11.01, -6.6],
      [-14, 6.6, -11.01, 6.6],
    ]),
  ]),
  // IHF: 40 x 20; goal area 6 m, free-throw line 9 m about a goal of 3 m.
  handball: court(40, 20, [halfway(20), ...goalArea(40, 6, 3), ...goalArea(40, 9, 3)]),
  // FIFA futsal: 40 x 20; penalty area 6 m about a goal of 3 m; centre circle 3 m.
  futsal: court(40, 20, [halfway(20), ...arc(0, 0, 3, 0, 360), ...goalArea(40, 6, 3)]),
  // FIVB: 18 x 9, attack lines 3 m from the centre line.
  volleyball: court(18, 9, [halfway(9), [-3, -4.5, -3, 4.5], [3, -4.5, 3, 4.5]]),
  // BWF: 13.4 x 6.1; singles 5.18; short service 1.98 from the net, long service of doubles 0.76 from the end.
  badminton: court(13.4, 6.1, [
    halfway(6.1),
    [-6.7, -2.59, 6.7, -2.59],
    [-6.7, 2.59, 6.7, 2.59],
    ...bothEnds([
      [-1.98, -3.05, -1.98, 3.05],
      [-5.94, -3.05, -5.94, 3.05],
      [-6.7, 0, -1.98, 0],
    ]),
  ]),
  // IFAB: 105 x 68 as at internationals; penalty area 16.5, goal area 5.5, circle 9.15.
  football: court(105, 68, [
    halfway(68),
    ...arc(0, 0, 9.15, 0, 360),
    ...bothEnds([
      ...box(-52.5, -20.16, -36, 20.16),
      ...box(-52.5, -9.16, -47, 9.16),
      ...arc(-41.5, 0, 9.15, -53, 53),
    ]),
  ]),
};

/** Lines of a court by its name, turned so that its long way is the field's; none where the name is not known. */
export function courtLines(name: string, fieldIsLongAlongY: boolean): Line[] {
  const found = Object.hasOwn(COURTS, name) ? COURTS[name] : undefined;
  if (found === undefined) return [];
  if (!fieldIsLongAlongY) return [...found.lines];
  return found.lines.map(([x1, y1, x2, y2]): Line => [-y1, x1, -y2, x2]);
}
