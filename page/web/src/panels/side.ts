// The side of the page: tabs, of which only the open one costs anything.

import { element, setHidden, setText } from "../dom.ts";

export interface Tab {
  readonly name: string;
  readonly title: string;
  readonly content: HTMLElement;
}

export class Side {
  readonly root = element("aside", { class: "side" });
  private readonly buttons: HTMLButtonElement[] = [];
  private openAt = 0;

  constructor(private readonly tabs: readonly Tab[]) {
    const list = element("div", { class: "tabs", label: "Panels", attributes: { role: "tablist" } });
    tabs.forEach((tab, i) => {
      const id = tab.name.toLowerCase();
      const made = element("button", {
        text: tab.name,
        title: tab.title,
        attributes: { type: "button", role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}` },
      });
      made.addEventListener("click", () => this.open(i));
      made.addEventListener("keydown", (event) => this.moveFocus(event));
      this.buttons.push(made);
      list.append(made);
      tab.content.id = `panel-${id}`;
      tab.content.setAttribute("role", "tabpanel");
      tab.content.setAttribute("aria-labelledby", `tab-${id}`);
      tab.content.classList.add("panel");
    });
    this.root.append(list, ...tabs.map((tab) => tab.content));
    this.open(0);
  }

  get openName(): string {
    return this.tabs[this.openAt]?.name ?? "";
  }

  open(at: number): void {
    if (this.tabs[at] === undefined) return;
    this.openAt = at;
    this.tabs.forEach((tab, i) => setHidden(tab.content, i !== at));
    this.buttons.forEach((made, i) => {
      made.setAttribute("aria-selected", i === at ? "true" : "false");
      made.tabIndex = i === at ? 0 : -1;
    });
  }

  /** A number or sign behind a tab's name. */
  mark(name: string, text: string): void {
    const at = this.tabs.findIndex((tab) => tab.name === name);
    const made = this.buttons[at];
    if (made !== undefined) setText(made, text === "" ? name : `${name} ${text}`);
  }

  private moveFocus(event: KeyboardEvent): void {
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    if (step === 0) return;
    event.preventDefault();
    event.stopPropagation();
    this.open((this.openAt + step + this.tabs.length) % this.tabs.length);
    this.buttons[this.openAt]?.focus();
  }
}
