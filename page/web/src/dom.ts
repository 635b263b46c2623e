// Elements of the page. Text is set as text and never as markup: names of nodes and persons come from strangers.

export type Child = Node | string;

export interface ElementOptions {
  class?: string;
  text?: string;
  title?: string;
  /** Name for who cannot see the element. */
  label?: string;
  attributes?: Readonly<Record<string, string>>;
}

/** An element with its children. */
export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  options: ElementOptions = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  if (options.class !== undefined) made.className = options.class;
  if (options.text !== undefined) made.textContent = options.text;
  if (options.title !== undefined) made.title = options.title;
  if (options.label !== undefined) made.setAttribute("aria-label", options.label);
  for (const [name, value] of Object.entries(options.attributes ?? {})) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/** A button that does one thing. What words it shows are its name, what it shows without words is named by its title. */
export function button(text: string, title: string, act: () => void, className = ""): HTMLButtonElement {
  // Without a text it is given one later.
  const hasWords = text === "" || /[\p{L}\p{N}]/u.test(text);
  const made = element("button", { class: className, text, title, ...(hasWords ? {} : { label: title }), attributes: { type: "button" } });
  made.addEventListener("click", act);
  return made;
}

/** Sets a text only when it changed: writing it again would make the browser lay out anew. */
export function setText(target: Node, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}

export function setClass(target: Element, name: string, isOn: boolean): void {
  if (target.classList.contains(name) !== isOn) target.classList.toggle(name, isOn);
}

export function setHidden(target: HTMLElement, isHidden: boolean): void {
  if (target.hidden !== isHidden) target.hidden = isHidden;
}

/** Tells a toggle's state to the eye and to screen readers. */
export function setPressed(target: HTMLElement, isOn: boolean): void {
  const value = isOn ? "true" : "false";
  if (target.getAttribute("aria-pressed") !== value) target.setAttribute("aria-pressed", value);
}

/**
 * Keeps one child per key, in order, without making those anew that are there already: a list that is rebuilt at every
 * status would lose focus and selection.
 */
export class KeyedChildren<T extends { readonly root: HTMLElement }> {
  private readonly rows = new Map<string, T>();

  constructor(
    private readonly parent: HTMLElement,
    private readonly make: (key: string) => T,
  ) {}

  update(keys: readonly string[], fill: (row: T, index: number) => void): void {
    const wanted = new Set(keys);
    for (const [key, row] of this.rows) {
      if (!wanted.has(key)) {
        row.root.remove();
        this.rows.delete(key);
      }
    }
    keys.forEach((key, index) => {
      let row = this.rows.get(key);
      if (row === undefined) {
        row = this.make(key);
        this.rows.set(key, row);
      }
      if (this.parent.children[index] !== row.root) {
        this.parent.insertBefore(row.root, this.parent.children[index] ?? null);
      }
      fill(row, index);
    });
  }
}
