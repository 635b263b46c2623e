// Dark and light: what the system prefers, until somebody chooses.

import { remember, remembered } from "./storage.ts";

const KEY = "farfield.theme";

export interface SceneColours {
  /** Of the floor beyond the field too. */
  readonly background: number;
  readonly field: number;
  readonly fineGrid: number;
  readonly coarseGrid: number;
  readonly paint: number;
  readonly outline: number;
  readonly shadow: number;
  readonly rim: number;
  readonly text: number;
}

const DARK: SceneColours = {
  background: 0x12161e,
  field: 0x1b222d,
  fineGrid: 0x242d3a,
  coarseGrid: 0x313d4e,
  paint: 0x8d9aab,
  outline: 0x4d8fd0,
  shadow: 0x0c1016,
  rim: 0x343c48,
  text: 0xe8edf4,
};

const LIGHT: SceneColours = {
  background: 0xe4e9ef,
  field: 0xf4f6f9,
  fineGrid: 0xdde3ea,
  coarseGrid: 0xc3ccd7,
  paint: 0x7d8998,
  outline: 0x2f6fb2,
  shadow: 0xb4bdc9,
  rim: 0x000000,
  text: 0x14181f,
};

export class Theme {
  private readonly prefersLight = matchMedia("(prefers-color-scheme: light)");
  private chosen = remembered("localStorage", KEY);
  private readonly listeners: ((colours: SceneColours) => void)[] = [];

  constructor() {
    this.prefersLight.addEventListener("change", () => this.apply());
    this.apply();
  }

  get isLight(): boolean {
    return this.chosen === null ? this.prefersLight.matches : this.chosen === "light";
  }

  get colours(): SceneColours {
    return this.isLight ? LIGHT : DARK;
  }

  /** Calls `listener` now and at every change. */
  onChange(listener: (colours: SceneColours) => void): void {
    this.listeners.push(listener);
    listener(this.colours);
  }

  toggle(): void {
    this.chosen = this.isLight ? "dark" : "light";
    remember("localStorage", KEY, this.chosen);
    this.apply();
  }

  private apply(): void {
    document.documentElement.dataset["theme"] = this.isLight ? "light" : "dark";
    for (const listener of this.listeners) listener(this.colours);
  }
}
