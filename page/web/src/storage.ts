// What the page remembers in the browser. Where the browser forbids that, it remembers nothing, and works.

export function remembered(storage: "localStorage" | "sessionStorage", key: string): string | null {
  try {
    return window[storage].getItem(key);
  } catch {
    return null;
  }
}

export function remember(storage: "localStorage" | "sessionStorage", key: string, value: string): void {
  try {
    window[storage].setItem(key, value);
  } catch {
    // A private window, or full: until the page is loaded anew the caller knows the value itself.
  }
}
