// Where the page begins: it connects, makes itself for the venue that answers, and draws while somebody looks.

import { Connection, type ConnectionState } from "./connection.ts";
import { element, setText } from "./dom.ts";
import { Page } from "./page.ts";
import type { Venue } from "./protocol/venue.ts";
import { Theme } from "./theme.ts";

/** A page that is hidden for so long gives up its connection. */
const SLEEP_AFTER_MS = 5000;

const theme = new Theme();
const canvas = element("canvas", { class: "scene" });
const waiting = element("p", { class: "waiting", text: "Looking for Farfield…", attributes: { role: "status" } });
document.body.append(waiting);

let page: Page | null = null;
let sleepTimer = 0;

const connection = new Connection({
  venue: begin,
  state: tell,
  text: (message) => page?.takeText(message),
  binary: (view) => page?.takeBinary(view),
  notice: (text) => page?.say(text),
  unreadable: (error) => page?.takeUnreadable(error),
});

function begin(venue: Venue): void {
  document.title = `${venue.name} · Farfield`;
  try {
    page = new Page(venue, connection, theme, canvas);
  } catch (error) {
    setText(waiting, `This browser cannot draw the field (WebGL 2 is needed): ${String(error)}`);
    return;
  }
  exposeCounters(page);
  requestAnimationFrame(draw);
}

function tell(state: ConnectionState): void {
  if (page !== null) page.setConnection(state);
  else if (state.kind === "refused") setText(waiting, state.reason);
  else if (state.kind === "away") setText(waiting, `Looking for Farfield: ${state.reason}. Trying again…`);
}

/** The browser asks for no frames of a hidden page, so nothing is drawn then. */
function draw(now_ms: number): void {
  page?.draw(now_ms);
  requestAnimationFrame(draw);
}

document.addEventListener("visibilitychange", () => {
  clearTimeout(sleepTimer);
  if (document.hidden) sleepTimer = window.setTimeout(() => connection.sleep(), SLEEP_AFTER_MS);
  else connection.wake();
});

/** Read-only numbers for tests and for the console. */
function exposeCounters(made: Page): void {
  const numbers = {
    get persons(): number {
      return made.scene.personsDrawn;
    },
    /** Whether limbs are drawn that nothing determines. */
    get guesses(): boolean {
      return made.scene.areGuessesDrawn;
    },
    get frames(): number {
      return made.counters.frames;
    },
    get ticks(): number {
      return made.counters.ticks;
    },
    get bytes(): number {
      return made.counters.bytes;
    },
    get tick(): number {
      return made.state.tick;
    },
    get frameMedian_ms(): number {
      return made.counters.frameMedian_ms;
    },
    get frameP99_ms(): number {
      return made.counters.frameP99_ms;
    },
    get framesPerSecond(): number {
      return made.counters.framesPerSecond;
    },
    get followed(): number | null {
      return made.state.followed;
    },
    get playback(): string | null {
      return made.state.playback?.state ?? null;
    },
    get unreadable(): string {
      return made.state.unreadableReason;
    },
  };
  Object.defineProperty(window, "farfield", { value: Object.freeze(numbers) });
}

void connection.open();
