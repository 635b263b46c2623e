// What the page shows, in words: a run that goes on, a recording that is solved again, a recording as it was. What is true of
// one of them is false of the others.

import type { Mode } from "./protocol/venue.ts";

export interface SourceWords {
  /** Whence everything comes. */
  readonly name: string;
  /** The pill where nothing comes and nobody knows why, and where it has ended. */
  readonly away: string;
  readonly ended: string;
  /** What is to be done where nothing comes, with commands between backticks; and what is to be known where it has ended. */
  readonly remedy: string;
  readonly afterEnd: string;
  /** The button that goes to the newest moment, what it does, and what the key does. */
  readonly newest: string;
  readonly goesToNewest: string;
  readonly newestKey: string;
  /** Why nobody is shown at a moment that has ticks. */
  readonly nobody: string;
}

export const SOURCE_WORDS: Readonly<Record<Mode, SourceWords>> = {
  live: {
    name: "fusion",
    away: "Fusion is away",
    ended: "The run has ended",
    remedy: "What you see is the last that came. Look whether fusion runs (`farfield status`); this page comes back by itself.",
    afterEnd: "Nothing is wrong. What you see is the last that came; a fusion that starts anew is shown by itself.",
    newest: "Live",
    goesToNewest: "Follow what happens now (L)",
    newestKey: "live again",
    nobody: "Nobody is tracked. Somebody is, a second or so after two viewpoints have seen them.",
  },
  replay: {
    name: "the replay",
    away: "The replay is away",
    ended: "The replay was ended",
    remedy: "What you see is the last that came. Look whether `farfield replay` runs; this page comes back by itself.",
    afterEnd: "Nothing is wrong. What you see is the last that came; its results are in the folder that it named.",
    newest: "Newest",
    goesToNewest: "Follow the newest that is solved (L)",
    newestKey: "the newest that is solved",
    nobody: "Nobody is tracked at this moment of the recording.",
  },
  recording: {
    name: "farfield view",
    away: "The recording is away",
    ended: "The view was ended",
    remedy: "What you see is the last that came. Look whether `farfield view` runs; this page comes back by itself.",
    afterEnd: "Nothing is wrong. What you see is the last that came; `farfield view` shows the recording again.",
    newest: "End",
    goesToNewest: "Go to the end of the recording (L)",
    newestKey: "the end of the recording",
    nobody: "Nobody is tracked at this moment of the recording.",
  },
};

/** Said where a replay tells nothing. */
export const REPLAY_TELLS = "A replay tells of people and events alone: how cameras and links were then is shown by farfield view.";
