// The token of the page's address.

import { remember, remembered } from "./storage.ts";

const TOKEN_KEY = "farfield.token";

/** The token of the page's address, which is taken out of it so that nobody copies it with a link. */
export function takeToken(): string | null {
  const found = /^#token=([0-9a-fA-F]{1,128})$/.exec(location.hash);
  if (found?.[1] === undefined) return remembered("sessionStorage", TOKEN_KEY) || null;
  remember("sessionStorage", TOKEN_KEY, found[1]);
  history.replaceState(null, "", location.pathname + location.search);
  return found[1];
}

export function forgetToken(): void {
  remember("sessionStorage", TOKEN_KEY, "");
}
