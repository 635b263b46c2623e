// Reading of JSON that comes from the server: every field is checked before anything is drawn from it, and what is wrong
// is said with its path, what was found and what was expected.

export class ProtocolError extends Error {}

/** Text longer than this is cut: no message of the server has longer ones, and none may fill the page. */
const MOST_CHARACTERS = 600;
/** Longest list of a message. */
const MOST_ITEMS = 4096;

export class Fields {
  private constructor(
    private readonly values: Readonly<Record<string, unknown>>,
    readonly path: string,
  ) {}

  static of(value: unknown, path: string): Fields {
    if (typeof value !== "object" || value === null || Array.isArray(value)) throw refused(path, value, "an object");
    return new Fields(value as Record<string, unknown>, path);
  }

  number(name: string, least = -Number.MAX_VALUE, most = Number.MAX_VALUE): number {
    const value = this.values[name];
    if (typeof value !== "number" || !Number.isFinite(value) || value < least || value > most) {
      throw refused(this.at(name), value, `a number from ${least} to ${most}`);
    }
    return value;
  }

  /** `null` where the server does not know it. */
  numberOrNull(name: string): number | null {
    return this.isAbsent(name) ? null : this.number(name);
  }

  /** A count or position, from 0 to `most`. */
  whole(name: string, most = Number.MAX_SAFE_INTEGER): number {
    const value = this.number(name, 0, most);
    if (!Number.isInteger(value)) throw refused(this.at(name), value, "a whole number");
    return value;
  }

  wholeOrNull(name: string, most?: number): number | null {
    return this.isAbsent(name) ? null : this.whole(name, most);
  }

  flag(name: string): boolean {
    const value = this.values[name];
    if (typeof value !== "boolean") throw refused(this.at(name), value, "true or false");
    return value;
  }

  text(name: string): string {
    return textOf(this.values[name], this.at(name));
  }

  textOrNull(name: string): string | null {
    return this.isAbsent(name) ? null : this.text(name);
  }

  /** One of a few words; a word that this page does not know is read as the last of them. */
  word<T extends string>(name: string, known: readonly [...T[], T]): T {
    const value = this.text(name) as T;
    return known.includes(value) ? value : (known[known.length - 1] as T);
  }

  list<T>(name: string, read: (value: unknown, path: string) => T): T[] {
    const value = this.values[name];
    if (!Array.isArray(value) || value.length > MOST_ITEMS) {
      throw refused(this.at(name), value, `a list of at most ${MOST_ITEMS}`);
    }
    return value.map((item, i) => read(item, `${this.at(name)}[${i}]`));
  }

  numbers(name: string, count: number): number[] {
    const values = this.list(name, numberOf);
    if (values.length !== count) throw refused(this.at(name), values.length, `${count} numbers`);
    return values;
  }

  numbersOrNull(name: string, count: number): number[] | null {
    return this.isAbsent(name) ? null : this.numbers(name, count);
  }

  object(name: string): Fields {
    return Fields.of(this.values[name], this.at(name));
  }

  objectOrNull(name: string): Fields | null {
    return this.isAbsent(name) ? null : this.object(name);
  }

  /** All of it, for who reads it otherwise. */
  get raw(): unknown {
    return this.values;
  }

  names(): string[] {
    return Object.keys(this.values);
  }

  isNull(name: string): boolean {
    return this.isAbsent(name);
  }

  private isAbsent(name: string): boolean {
    return this.values[name] === null || this.values[name] === undefined;
  }

  private at(name: string): string {
    return `${this.path}.${name}`;
  }
}

export function numberOf(value: unknown, path: string): number {
  if (typeof value !== "number" || !Number.isFinite(value)) throw refused(path, value, "a finite number");
  return value;
}

export function textOf(value: unknown, path: string): string {
  if (typeof value !== "string") throw refused(path, value, "a text");
  return value.slice(0, MOST_CHARACTERS);
}

function refused(path: string, found: unknown, expected: string): ProtocolError {
  const shown = JSON.stringify(found)?.slice(0, 60) ?? "nothing";
  return new ProtocolError(`${path} is ${shown}, expected ${expected}`);
}
