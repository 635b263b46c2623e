// The connection to the server: the token, the WebSocket, and coming back by itself when it is lost.

import { readCalibration, type Calibration } from "./protocol/calibration.ts";
import { ProtocolError } from "./protocol/checked.ts";
import { readSeries, readText, type Request, type Series, type TextMessage } from "./protocol/text.ts";
import { readVenue, type Venue } from "./protocol/venue.ts";
import { RequestPacer } from "./request_pacer.ts";
import { forgetToken, takeToken } from "./token.ts";

const SUBPROTOCOL = "farfield.page.v1";
const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 5000;
/** The server says every second where it is in time: one that is silent for longer than this is away, whatever the socket says. */
const SILENT_MS = 5000;
const CONNECTING_MS = 15_000;
const HTTP_TIMEOUT_MS = 8000;
/** With which code a server that stops closes its sockets (RFC 6455, 7.4.1: going away). */
const STOPS = 1001;

export type ConnectionState =
  | { kind: "connecting" }
  | { kind: "open" }
  | { kind: "asleep" }
  /** `isEnded`: the server said that it stops; else nobody knows why nothing comes. */
  | { kind: "away"; since_ms: number; reason: string; isEnded: boolean }
  | { kind: "refused"; reason: string };

export interface Receiver {
  venue(venue: Venue): void;
  state(state: ConnectionState): void;
  text(message: TextMessage): void;
  binary(view: DataView): void;
  /** Something that the operator should know once. */
  notice(text: string): void;
  /** A message that could not be read, with why. */
  unreadable(error: string): void;
}

export class Connection {
  private token = takeToken();
  private socket: WebSocket | null = null;
  private retry_ms = FIRST_RETRY_MS;
  private timer = 0;
  private lastMessage_ms = 0;
  private awaySince_ms = 0;
  private hasStopped = false;
  private isAsleep = false;
  private nextRequest = 1;
  /** Of the attempts to connect the newest: what an older one finds out means nothing any more. */
  private attempt = 0;
  private venueText = "";
  private readonly pacer = new RequestPacer((request) => {
    if (this.isOpen) this.socket?.send(JSON.stringify(request));
  });
  private readonly waiting = new Map<number, (error: string | null) => void>();

  constructor(private readonly receiver: Receiver) {
    setInterval(() => this.watchSilence(), 1000);
  }

  async open(): Promise<void> {
    clearTimeout(this.timer);
    if (this.isAsleep || this.socket !== null) return;
    const attempt = ++this.attempt;
    if (this.awaySince_ms === 0) this.receiver.state({ kind: "connecting" });
    try {
      const response = await this.get("/api/venue");
      if (attempt !== this.attempt) return;
      if (response.status === 401 && this.token !== null) {
        // Fusion makes another token at every start; on its own machine reading needs none.
        this.token = null;
        forgetToken();
        this.receiver.notice("Fusion has started anew. To do more than look, open the address that it printed.");
        return this.open();
      }
      if (response.status === 401) {
        const reason = "This address needs the token that was printed at the start: open that address, or its QR code.";
        this.receiver.state({ kind: "refused", reason });
        return;
      }
      if (!response.ok) throw new Error(`the server answers ${response.status}`);
      const text = await response.text();
      if (attempt !== this.attempt) return;
      this.takeVenue(text);
      this.connect();
    } catch (error) {
      if (attempt !== this.attempt) return;
      this.retryLater(error instanceof ProtocolError ? error.message : "it does not answer");
    }
  }

  /** A page that nobody sees keeps no connection. */
  sleep(): void {
    if (this.isAsleep) return;
    this.isAsleep = true;
    this.attempt++;
    clearTimeout(this.timer);
    this.socket?.close();
    this.socket = null;
    this.receiver.state({ kind: "asleep" });
  }

  wake(): void {
    if (!this.isAsleep) return;
    this.isAsleep = false;
    void this.open();
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Sends a request whose answer nobody waits for. */
  send(request: Request): void {
    if (this.isOpen) this.pacer.send(request, performance.now());
  }

  /** Sends a request; the promise is what the server says against it, `null` when it was done. */
  ask(request: Request): Promise<string | null> {
    if (!this.isOpen) return Promise.resolve("nothing comes at the moment");
    const number = this.nextRequest++;
    return new Promise((resolve) => {
      this.waiting.set(number, resolve);
      this.socket?.send(JSON.stringify({ ...request, request: number }));
    });
  }

  async series(person: number, angles: readonly number[], from: number, to: number): Promise<Series> {
    const query = `person=${person}&angles=${angles.join(",")}&from=${Math.round(from)}&to=${Math.round(to)}`;
    const response = await this.get(`/api/series?${query}`);
    if (!response.ok) throw new Error(`the server answers ${response.status}`);
    return readSeries(await response.json());
  }

  /** The newest picture of a camera; `null` where there is none, `"same"` where it is that of `tag`. */
  async thumbnail(camera: number, tag: string): Promise<{ picture: Blob; tag: string } | "same" | null> {
    const response = await this.get(`/api/thumbnail/${camera}`, tag === "" ? {} : { "If-None-Match": tag });
    if (response.status === 304) return "same";
    if (response.status === 204) return null;
    if (!response.ok) throw new Error(`the server answers ${response.status}`);
    return { picture: await response.blob(), tag: response.headers.get("ETag") ?? "" };
  }

  /** What is said of the calibration; a server of before does not know. */
  async calibration(): Promise<Calibration | null> {
    const response = await this.get("/api/calibration");
    return response.ok ? readCalibration(await response.json()) : null;
  }

  private get(path: string, more: Readonly<Record<string, string>> = {}): Promise<Response> {
    const headers: Record<string, string> = { ...more };
    if (this.token !== null) headers["Authorization"] = `Bearer ${this.token}`;
    return fetch(path, { headers, cache: "no-store", signal: AbortSignal.timeout(HTTP_TIMEOUT_MS) });
  }

  private takeVenue(text: string): void {
    if (text === this.venueText) return;
    // Everything on the page is made for one venue; another one, or a new release of the page, starts afresh.
    if (this.venueText !== "") return location.reload();
    this.receiver.venue(readVenue(JSON.parse(text)));
    this.venueText = text;
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const protocols = this.token === null ? [SUBPROTOCOL] : [SUBPROTOCOL, `token.${this.token}`];
    const socket = new WebSocket(`${scheme}://${location.host}/ws`, protocols);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.lastMessage_ms = performance.now();
    socket.onopen = () => {
      this.retry_ms = FIRST_RETRY_MS;
      this.awaySince_ms = 0;
      this.hasStopped = false;
      this.receiver.state({ kind: "open" });
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer | string>) => this.take(event.data);
    socket.onclose = (event) => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.hasStopped = event.code === STOPS;
      if (!this.isAsleep) this.retryLater("the connection has ended");
    };
  }

  private take(data: ArrayBuffer | string): void {
    this.lastMessage_ms = performance.now();
    try {
      if (typeof data !== "string") return this.receiver.binary(new DataView(data));
      const message = readText(data);
      if (message === null) return;
      if (message.type === "answer") this.answer(message.request, message.isOk ? null : message.error);
      else this.receiver.text(message);
    } catch (error) {
      if (!(error instanceof ProtocolError || error instanceof RangeError)) throw error;
      this.receiver.unreadable(error.message);
    }
  }

  private answer(request: number | null, error: string | null): void {
    if (request === null) return this.receiver.unreadable(error ?? "a request was refused");
    this.waiting.get(request)?.(error);
    this.waiting.delete(request);
  }

  private retryLater(reason: string): void {
    for (const resolve of this.waiting.values()) resolve("the connection has ended");
    this.waiting.clear();
    this.pacer.clear();
    if (this.awaySince_ms === 0) this.awaySince_ms = Date.now();
    this.receiver.state({ kind: "away", since_ms: this.awaySince_ms, reason, isEnded: this.hasStopped });
    this.timer = window.setTimeout(() => void this.open(), this.retry_ms);
    this.retry_ms = Math.min(LONGEST_RETRY_MS, this.retry_ms * 1.6);
  }

  private watchSilence(): void {
    const socket = this.socket;
    if (socket === null) return;
    const patience_ms = socket.readyState === WebSocket.OPEN ? SILENT_MS : CONNECTING_MS;
    if (performance.now() - this.lastMessage_ms < patience_ms) return;
    this.socket = null;
    socket.close();
    this.retryLater("it is silent");
  }
}
