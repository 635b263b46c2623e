// Alarms that say the same of many nodes, cameras or links become one line: twelve boxes whose clocks are off are one
// problem with one remedy, and must not push the other problems off the screen.

export interface Alarm {
  readonly key: string;
  readonly isFailed: boolean;
  readonly text: string;
  readonly remedy: string;
  readonly since_us: number | null;
}

export interface AlarmGroup extends Alarm {
  /** Those that it stands for; empty where it is a single alarm. */
  readonly members: readonly Alarm[];
}

/** So many alike are one line. */
const LEAST_ALIKE = 2;
/** Names that are listed before the rest is only counted. */
const MOST_NAMES = 8;

const KINDS: Readonly<Record<string, string>> = {
  node: "nodes",
  link: "links",
  camera: "cameras",
  clock: "clocks",
  key: "keys",
  recording: "recordings",
};

/** Groups in the order in which the first of each came; alarms that are like no other stay as they are. */
export function grouped(alarms: readonly Alarm[]): AlarmGroup[] {
  const alike = new Map<string, Alarm[]>();
  for (const alarm of alarms) {
    const likeness = likenessOf(alarm);
    alike.set(likeness, [...(alike.get(likeness) ?? []), alarm]);
  }
  return [...alike].flatMap(([likeness, members]): AlarmGroup[] => {
    const [first] = members;
    if (first === undefined) return [];
    // Of one node that says several such things each is said: "2 nodes: fusion, fusion" would be none of them.
    const isOfMany = new Set(members.map(nameOf)).size === members.length;
    if (members.length < LEAST_ALIKE || !isOfMany) return members.map((alarm) => ({ ...alarm, members: [] }));
    const kind = kindOf(first);
    const names = members.slice(0, MOST_NAMES).map(nameOf).join(", ");
    const rest = members.length > MOST_NAMES ? ` and ${members.length - MOST_NAMES} more` : "";
    const since = members.map((alarm) => alarm.since_us).filter((us) => us !== null);
    return [
      {
        key: `group/${likeness}`,
        isFailed: first.isFailed,
        text: `${members.length} ${KINDS[kind] ?? kind}: ${names}${rest}. ${upper(first.text)}`,
        remedy: sharedRemedy(members),
        since_us: since.length === 0 ? null : Math.min(...since),
        members,
      },
    ];
  });
}

/** What mends them all; where each names itself in it, in words that are true of all. */
function sharedRemedy(members: readonly Alarm[]): string {
  const [first] = members;
  if (first === undefined) return "";
  if (members.every((alarm) => alarm.remedy === first.remedy)) return first.remedy;
  const plain = (alarm: Alarm): string => alarm.remedy.replaceAll(nameOf(alarm), "NAME");
  if (members.every((alarm) => plain(alarm) === plain(first))) return `${plain(first)} (for each, by its name)`;
  return "Each has a remedy of its own: open them.";
}

/** What two alarms have in common that say the same: all but whose it is, and how much. */
function likenessOf(alarm: Alarm): string {
  const name = nameOf(alarm);
  if (name === "" || !Object.hasOwn(KINDS, kindOf(alarm))) return alarm.key;
  const plain = alarm.text.replaceAll(name, "?").replaceAll(/[-−]?\d+(\.\d+)?/g, "#");
  return `${kindOf(alarm)}/${alarm.isFailed ? "failed" : "warning"}/${plain}`;
}

function kindOf(alarm: Alarm): string {
  return alarm.key.split("/", 1)[0] ?? "";
}

/** Whose it is; behind the name a key may say what of it. */
function nameOf(alarm: Alarm): string {
  return alarm.key.split("/", 2)[1] ?? "";
}

function upper(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
