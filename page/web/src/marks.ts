// Where the page of marks begins: it asks for what there is, and makes itself for it.

import { element, setText } from "./dom.ts";
import { readDocument } from "./marks/document.ts";
import { MarksPage } from "./marks/marks_page.ts";
import { LastPictures } from "./marks/pictures.ts";
import { Theme } from "./theme.ts";
import { takeToken } from "./token.ts";

const TIMEOUT_MS = 15_000;

const theme = new Theme();
const token = takeToken();
const waiting = element("p", { class: "waiting", text: "Looking for the command…", attributes: { role: "status" } });
document.body.append(waiting);

function ask(path: string, body?: string, signal: AbortSignal | null = AbortSignal.timeout(TIMEOUT_MS)): Promise<Response> {
  const headers: Record<string, string> = token === null ? {} : { Authorization: `Bearer ${token}` };
  const options: RequestInit = { headers, cache: "no-store", signal };
  if (body !== undefined) Object.assign(options, { method: "PUT", body });
  return fetch(path, options);
}

async function send(body: string): Promise<{ status: number; text: string }> {
  const response = await ask("/api/marks", body);
  return { status: response.status, text: await response.text() };
}

async function picture(number: number): Promise<ImageBitmap> {
  // Through a tunnel a large one takes as long as it takes.
  const response = await ask(`/api/picture/${number}`, undefined, null);
  if (!response.ok) throw new Error((await response.text()).trim());
  return createImageBitmap(await response.blob(), { colorSpaceConversion: "none" });
}

async function begin(): Promise<void> {
  const response = await ask("/api/marks");
  if (response.status === 401) {
    setText(waiting, "This page needs the address that `farfield calibrate marks` printed: open that one, as a whole.");
    return;
  }
  if (!response.ok) throw new Error(`the command answers ${response.status}`);
  const read = readDocument(await response.json());
  document.title = `${read.file} · Farfield`;
  const pictures = new LastPictures(picture);
  const page = new MarksPage(read, send, (number) => pictures.get(number), theme);
  const numbers = {
    get camera(): string {
      return page.camera;
    },
    get next(): string | null {
      return page.nextToClick;
    },
    get clicks(): number {
      return page.clicks;
    },
    get drawnLines(): number {
      return page.drawnLines;
    },
    get isSaved(): boolean {
      return page.isSaved;
    },
  };
  Object.defineProperty(window, "farfieldMarks", { value: Object.freeze(numbers) });
}

begin().catch((error: unknown) => setText(waiting, `There is nothing to click on: ${String(error)}. Is the command still running?`));
