// The page of one venue: what comes is put into the state, and what is on the screen is drawn from it.

import { Blender } from "./blend.ts";
import { chartColours, type ChartColours } from "./charts/pen.ts";
import type { Connection, ConnectionState } from "./connection.ts";
import { Counters } from "./counters.ts";
import { element, setClass, setHidden, setText } from "./dom.ts";
import { Keyboard } from "./keyboard.ts";
import { pageKeys } from "./page_keys.ts";
import { AlarmStrip } from "./panels/alarms.ts";
import { AnglePanel } from "./panels/angles.ts";
import { CamerasPanel, healthOfCamera } from "./panels/cameras.ts";
import { EventsPanel } from "./panels/events.ts";
import { Header } from "./panels/header.ts";
import { LinksPanel } from "./panels/links.ts";
import { PeopleList } from "./panels/people.ts";
import { PersonPanel } from "./panels/person.ts";
import { Side } from "./panels/side.ts";
import { Timeline } from "./panels/timeline.ts";
import { Toolbar } from "./panels/toolbar.ts";
import type { Level } from "./palette.ts";
import { Player } from "./player.ts";
import { ProtocolError } from "./protocol/checked.ts";
import type { Status } from "./protocol/status.ts";
import type { IdentityEvent, TextMessage } from "./protocol/text.ts";
import {
  KIND_ANGLES,
  KIND_CAMERA,
  KIND_PEOPLE,
  kindOf,
  readCameraView,
  readChosenAngles,
  sessionOf,
  unobservedOf,
  type CameraView,
} from "./protocol/ticks.ts";
import type { Venue } from "./protocol/venue.ts";
import { FieldScene } from "./scene/scene.ts";
import { SOURCE_WORDS } from "./source_words.ts";
import { KEPT_EVENTS, RUN_ENDED, eventsOf, isPast, nameOf, type Actions, type PageState } from "./state.ts";
import type { Theme } from "./theme.ts";
import { Thumbnails } from "./thumbnails.ts";

/** Panels are brought up to date so often; the scene at every frame. */
const PANELS_EVERY_MS = 200;
const CHARTS_EVERY_MS = 66;
const SAID_MS = 4500;
/** Ticks a second that a phone asks for: its screen is small and its battery too. */
const PHONE_RATE_HZ = 30;

export class Page implements Actions {
  readonly counters = new Counters();
  readonly state: PageState;
  readonly scene: FieldScene;
  private readonly blender: Blender;
  private readonly player: Player;
  private readonly header: Header;
  private readonly alarms = new AlarmStrip();
  private readonly toolbar: Toolbar;
  private readonly timeline: Timeline;
  private readonly people: PeopleList;
  private readonly person: PersonPanel;
  private readonly angles: AnglePanel;
  private readonly cameras: CamerasPanel;
  private readonly links: LinksPanel;
  private readonly events: EventsPanel;
  private readonly side: Side;
  private readonly keyboard: Keyboard;
  private readonly said = element("div", { class: "said", attributes: { role: "status" } });
  private cameraView: CameraView | null = null;
  private newest: DataView | null = null;
  private colours: ChartColours = { text: "", faint: "", line: "" };
  private lastPanels_ms = 0;
  private lastCharts_ms = 0;
  private saidTimer = 0;
  private chosenCameras: readonly number[] = [];

  constructor(
    venue: Venue,
    private readonly connection: Connection,
    theme: Theme,
    canvas: HTMLCanvasElement,
  ) {
    this.blender = new Blender(venue.joints.length);
    this.player = new Player(venue.rate_hz);
    this.state = emptyState(venue, this.blender);
    this.scene = new FieldScene(venue, canvas);
    this.keyboard = new Keyboard(
      pageKeys({
        view: this.scene.view,
        theme,
        showHelp: () => this.keyboard.toggle(),
        openTab: (at) => this.side.open(at),
        newest: SOURCE_WORDS[venue.mode].newestKey,
        toggleRecording: venue.actions.has("record") ? () => void this.header.toggleRecording() : null,
        toolbar: () => this.toolbar,
        timeline: () => this.timeline,
        followNext: (step) => this.followNext(step),
        escape: () => this.escape(),
      }),
    );
    this.header = new Header(this, venue.name, theme, () => this.keyboard.toggle());
    this.toolbar = new Toolbar(this.scene, this, this.state);
    this.timeline = new Timeline(this, this.state);
    this.angles = new AnglePanel(this.state, connection);
    this.people = new PeopleList(this, this.state);
    this.person = new PersonPanel(this.state, this, this.angles.all, this.angles.root);
    this.cameras = new CamerasPanel(this.state, new Thumbnails(this.state, connection), this);
    this.links = new LinksPanel(venue.mode);
    this.events = new EventsPanel(this);
    this.side = new Side([
      { name: "People", title: "Who is there (1)", content: element("div", {}, this.person.root, this.people.root) },
      { name: "Cameras", title: "What each camera sees and whom it serves (2)", content: this.cameras.root },
      { name: "Links", title: "Delay, links, nodes (3)", content: this.links.root },
      { name: "Events", title: "Who came, went, was lost and found (4)", content: this.events.root },
    ]);
    const field = element("section", { class: "field", label: "The field" }, canvas, this.toolbar.root, this.toolbar.keys, this.said);
    document.body.replaceChildren(
      this.header.root,
      this.alarms.root,
      this.alarms.announced,
      element("main", {}, field, this.side.root),
      this.timeline.root,
      this.keyboard.overlay,
    );
    const { root } = this.toolbar;
    new ResizeObserver(() => this.scene.setTop(root.offsetTop + root.offsetHeight)).observe(root);
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "The field in 3D. Arrow keys turn the view, plus and minus come nearer.");
    watchClicks(canvas, (x, y) => this.follow(this.scene.personAt(x, y)));
    theme.onChange((colours) => {
      this.scene.setTheme(colours);
      this.colours = chartColours();
    });
  }

  // What comes.

  setConnection(connection: ConnectionState): void {
    const wasOpen = this.state.connection.kind === "open";
    this.state.connection = connection;
    setClass(document.documentElement, "is-away", connection.kind !== "open");
    if (connection.kind === "open" && !wasOpen) this.askAgain();
    this.updatePanels();
  }

  /** After a new connection the server knows nothing of what was asked before. */
  private askAgain(): void {
    this.state.hasRunEnded = false;
    this.state.newestStatus = null;
    if (isNarrow()) this.send({ do: "rate", hz: PHONE_RATE_HZ });
    if (this.state.openCamera !== null) this.send({ do: "camera", camera: this.state.openCamera });
    if (this.state.playback?.state === "paused" && Number.isFinite(this.state.tick)) {
      this.send({ do: "seek", tick: Math.round(this.state.tick) });
    }
    this.angles.restart();
    // The sheet is somewhere else after each start of the server; without an answer the page is as it was.
    this.connection.calibration().then(
      (calibration) => calibration !== null && this.cameras.calibration.take(calibration),
      () => undefined,
    );
  }

  takeText(message: TextMessage): void {
    switch (message.type) {
      case "hello":
        this.state.actions = new Set(message.mayAct ? message.actions : []);
        break;
      case "names":
        this.state.names = message.names;
        this.scene.setNames(message.names);
        break;
      case "events":
        this.takeEvents(message.events);
        break;
      case "playback":
        this.state.playback = message.playback;
        this.player.setStill(message.playback.state === "paused");
        break;
      case "status":
        this.state.status = message.status;
        this.state.status_ms = performance.now();
        this.takeNewest(message.status);
        this.links.take(message.status);
        this.scene.setCameraLevels(this.cameraLevels());
        break;
      case "answer":
        break;
    }
    if (message.type !== "events") this.updatePanels();
  }

  /** Who looks back gets statuses of then: of what goes on now, and of the end of the run, the newest tells. */
  private takeNewest(status: Status): void {
    const { state } = this;
    if ((status.at_us ?? 0) < (state.newestStatus?.at_us ?? 0)) return;
    state.newestStatus = status;
    state.hasRunEnded = state.venue.mode === "live" && status.alarms.some((alarm) => alarm.key === RUN_ENDED);
  }

  takeBinary(view: DataView): void {
    this.counters.bytes += view.byteLength;
    switch (kindOf(view)) {
      case KIND_PEOPLE:
        this.takePeople(view);
        break;
      case KIND_CAMERA:
        this.cameraView = readCameraView(view);
        break;
      case KIND_ANGLES: {
        const newest = this.newest;
        if (newest !== null) this.angles.take(readChosenAngles(view), (id, angle) => unobservedOf(newest, id, angle));
        break;
      }
    }
  }

  takeUnreadable(error: string): void {
    this.state.unreadable++;
    this.state.unreadableReason = error;
  }

  private takePeople(view: DataView): void {
    this.counters.ticks++;
    // Ids of two sessions are unrelated: nothing of the one before may be blended or followed.
    if (this.newest !== null && sessionOf(view) !== sessionOf(this.newest)) {
      this.player.clear();
      this.state.events = eventsOf(this.state.events, sessionOf(view));
      this.follow(null);
    }
    this.newest = view;
    this.player.push(view, performance.now());
  }

  private takeEvents(events: readonly IdentityEvent[]): void {
    const last = this.state.events[this.state.events.length - 1];
    // The server sends the last ones again to who connects again.
    const fresh = events.filter((event) => last === undefined || event.at_us > last.at_us);
    this.state.events = [...this.state.events, ...fresh].slice(-KEPT_EVENTS);
  }

  private cameraLevels(): Level[] {
    const { status, venue } = this.state;
    return venue.cameras.map((camera, i) => healthOfCamera(status, i, camera.viewpoint)[0]);
  }

  // What is drawn.

  /** Draws a frame. */
  draw(now_ms: number): void {
    const start_ms = performance.now();
    const moment = this.player.at(now_ms);
    if (moment !== null) {
      try {
        this.blender.update(moment);
        this.state.tick = moment.tick;
      } catch (error) {
        if (!(error instanceof ProtocolError || error instanceof RangeError)) throw error;
        this.takeUnreadable(error.message);
        this.player.clear();
      }
    }
    this.scene.draw(this.blender.people, Number.isFinite(this.state.tick) ? this.state.tick : 0, now_ms, this.chosenCameras);
    if (now_ms - this.lastCharts_ms >= CHARTS_EVERY_MS) {
      this.lastCharts_ms = now_ms;
      this.drawCharts();
    }
    if (now_ms - this.lastPanels_ms >= PANELS_EVERY_MS) this.updatePanels();
    this.counters.frame(start_ms, performance.now());
  }

  private drawCharts(): void {
    const open = this.side.openName;
    if (open === "People") this.angles.draw(this.colours);
    else if (open === "Cameras") this.cameras.draw(this.state.openCamera, this.cameraView, this.colours);
    else if (open === "Links") this.links.draw(this.colours);
  }

  private updatePanels(): void {
    this.lastPanels_ms = performance.now();
    const { state } = this;
    setClass(document.documentElement, "is-past", isPast(state));
    this.header.update(state);
    this.alarms.update(state);
    this.toolbar.update();
    this.timeline.update();
    this.chosenCameras = (state.status?.cameras ?? [])
      .filter((camera) => state.followed !== null && camera.persons.includes(state.followed))
      .map((camera) => camera.camera);
    switch (this.side.openName) {
      case "People":
        this.person.update();
        this.people.update(state);
        break;
      case "Cameras":
        this.cameras.update();
        break;
      case "Links":
        this.links.update(state);
        break;
      case "Events":
        this.events.update(state);
        break;
    }
    this.side.mark("People", state.people.count > 0 ? `${state.people.count}` : "");
    const red = this.cameraLevels().filter((level) => level === "failed").length;
    this.side.mark("Cameras", red > 0 ? `✕ ${red}` : "");
    const bad = (state.status?.links ?? []).filter((link) => link.state !== "works").length;
    this.side.mark("Links", bad > 0 ? `! ${bad}` : "");
  }

  // What the operator asks for.

  follow(person: number | null): void {
    if (person === this.state.followed) return;
    this.state.followed = person;
    this.scene.view.follow(person);
    if (person !== null) this.person.open(person);
    this.angles.restart();
    this.updatePanels();
    if (person === null) return;
    // On a phone list and field are below each other, and it is the field that one wants to see.
    if (isNarrow()) scrollTo({ top: 0 });
    else this.person.root.scrollIntoView({ block: "nearest" });
  }

  openCamera(camera: number | null): void {
    this.state.openCamera = camera;
    this.cameraView = null;
    this.send({ do: "camera", camera });
    this.updatePanels();
  }

  lookThrough(camera: number): void {
    this.follow(null);
    this.scene.view.setThrough(camera);
    this.updatePanels();
  }

  send(request: Parameters<Actions["send"]>[0]): void {
    this.connection.send(request);
  }

  ask(request: Parameters<Actions["ask"]>[0]): Promise<string | null> {
    return this.connection.ask(request);
  }

  say(text: string): void {
    setText(this.said, text);
    setHidden(this.said, false);
    clearTimeout(this.saidTimer);
    this.saidTimer = window.setTimeout(() => setHidden(this.said, true), SAID_MS);
  }

  private followNext(step: number): void {
    const { people } = this.state;
    if (people.count === 0) return;
    const at = this.state.followed === null ? -1 : people.indexOf(this.state.followed);
    const next = at < 0 ? (step > 0 ? 0 : people.count - 1) : (at + step + people.count) % people.count;
    const id = people.ids[next];
    if (id === undefined) return;
    this.follow(id);
    this.say(`Following ${nameOf(this.state, id)}`);
  }

  private escape(): void {
    if (this.state.followed !== null) this.follow(null);
    else if (this.scene.view.through !== null) this.toolbar.toField();
  }
}

function emptyState(venue: Venue, blender: Blender): PageState {
  return {
    venue,
    connection: { kind: "connecting" },
    people: blender.people,
    tick: NaN,
    status: null,
    newestStatus: null,
    hasRunEnded: false,
    status_ms: 0,
    playback: null,
    names: new Map(),
    events: [],
    actions: new Set(),
    followed: null,
    openCamera: null,
    unreadable: 0,
    unreadableReason: "",
  };
}

/** Whether the style sheet lays the page out for a phone. */
function isNarrow(): boolean {
  return matchMedia("(max-width: 760px)").matches;
}

/** A click that is no drag. */
function watchClicks(canvas: HTMLCanvasElement, act: (x_px: number, y_px: number) => void): void {
  const FARTHEST_PX = 5;
  let [downX, downY] = [0, 0];
  canvas.addEventListener("pointerdown", (event) => ([downX, downY] = [event.clientX, event.clientY]));
  canvas.addEventListener("click", (event) => {
    if (Math.hypot(event.clientX - downX, event.clientY - downY) > FARTHEST_PX) return;
    const bounds = canvas.getBoundingClientRect();
    act(event.clientX - bounds.left, event.clientY - bounds.top);
  });
}
