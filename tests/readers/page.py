"""Opens the live page in Debian's Chromium and acts like an operator.

    pip install playwright websockets
    python tests/readers/page.py URL SHOTS [--people N] [--start COMMAND]

URL is the page's address as printed, with its token if it has one. With --start, COMMAND is run first, and the address is the
last one that it prints (URL is then `-`); COMMAND must serve the sheet of its calibration. SHOTS is the folder for screenshots.
--people: least number of people in the venue. The venue must have an alarm at times, as that of `cargo run -p farfield-page
--example synthetic_page`. Chromium is /usr/bin/chromium, or $CHROMIUM. Prints a line per check; exits with 1 if one failed.
"""

import argparse
import asyncio
import contextlib
import http.client
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
import urllib.parse

import pictures
import websockets
from playwright.sync_api import Error, sync_playwright

# Without a graphics card Chromium renders WebGL in software, and logs it.
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
# Seconds: software rendering is slow on a loaded machine.
PATIENCE_S = 60
# JavaScript of a frame, median, milliseconds, with 60 people on an idle machine.
MOST_FRAME_MS = 3.0

failures = []


def check(what, is_right, found=""):
    print(f"{'ok' if is_right else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not is_right:
        failures.append(what)


class Visit:
    """An open page, with its console messages."""

    def __init__(self, browser, url, **context):
        self.context = browser.new_context(**context)
        self.page = self.context.new_page()
        self.console = []
        self.page.on("console", lambda m: self.console.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.console.append(str(error)))
        self.began = time.monotonic()
        self.page.goto(url)

    def counter(self, name):
        # Evaluated by the debugger: the page's policy forbids text as code.
        return self.page.evaluate(f"window.farfield ? window.farfield.{name} : null")

    def until(self, is_so, patience_s=PATIENCE_S):
        """Seconds until a condition holds, or None."""
        began = time.monotonic()
        while time.monotonic() - began < patience_s:
            with contextlib.suppress(Error):
                if is_so():
                    return time.monotonic() - began
            self.page.wait_for_timeout(100)
        return None

    def shot(self, folder, name, **options):
        pictures.take(self.page, folder / f"{name}.png", **options)


def people_are_drawn(visit, folder, people):
    is_there = visit.until(lambda: (visit.counter("persons") or 0) >= people) is not None
    check(f"{people} people are drawn", is_there, f"{visit.counter('persons')} after {time.monotonic() - visit.began:.1f} s")
    frames = visit.counter("frames")
    visit.page.wait_for_timeout(5000)
    check("frames go on", visit.counter("frames") > frames, f"{visit.counter('framesPerSecond'):.1f} frames/s")
    check("every message could be read", visit.counter("unreadable") == "", visit.counter("unreadable"))
    visit.shot(folder, "field-dark")


def draws_quickly(visit):
    """Wall-clock times include other programs, so a busy machine gives no verdict."""
    visit.page.wait_for_timeout(5000)
    median_ms, load = visit.counter("frameMedian_ms"), os.getloadavg()[0]
    times = f"median {median_ms:.2f} ms, P99 {visit.counter('frameP99_ms'):.1f} ms, load {load:.1f}"
    if load > 1.5 * os.cpu_count():
        print(f"left out: JavaScript of a frame, since the machine is busy ({times})")
    else:
        check("JavaScript of a frame", median_ms <= MOST_FRAME_MS, times)


def follows(visit, folder):
    page = visit.page
    page.locator(".person").first.click()
    check("a click follows a person", visit.until(lambda: visit.counter("followed") is not None) is not None)
    check("details of the followed person are shown", page.locator(".detail h2").is_visible())
    page.wait_for_timeout(3000)
    visit.shot(folder, "follow")
    page.keyboard.press("c")
    check("certainty has a key", page.locator(".key").is_visible())
    page.wait_for_timeout(800)
    visit.shot(folder, "certainty")
    page.keyboard.press("c")
    page.keyboard.press("Escape")
    check("Escape stops following", visit.until(lambda: visit.counter("followed") is None) is not None)
    page.keyboard.press("t")
    page.wait_for_timeout(1500)
    visit.shot(folder, "top")
    page.keyboard.press("f")


def guesses(visit):
    """Undetermined parts must look different from seen ones: a person in no view is a guess from head to toe."""
    page = visit.page
    key = page.locator(".guess-key")
    is_drawn = visit.until(lambda: visit.counter("guesses") and key.is_visible()) is not None
    check("limbs that nothing determines are drawn as guesses, with a key", is_drawn)


def names(visit):
    """A name stays text, whatever it contains."""
    page = visit.page
    page.locator(".person").first.click()
    form = page.locator(".name-form")
    if form.is_visible():
        name = "<i>Anna</i> & Co"
        form.locator("input").fill(name)
        form.locator("button").click()
        title = page.locator(".detail h2")
        is_named = visit.until(lambda: title.inner_text() == name)
        check("a person gets a name, which stays text", is_named is not None, title.inner_text())
        form.locator("input").fill("")
        form.locator("button").click()
        check("and loses it", visit.until(lambda: title.inner_text() != name) is not None)
    else:
        print("left out: names, which the server does not take without a token")
    page.locator("canvas.scene").focus()
    page.keyboard.press("Escape")


def opens_the_sheet(visit, folder, must_be_there):
    """The sheet of the calibration, if there is one, in a tab of its own without rights."""
    link = visit.page.locator(".sheet-link")
    hint = visit.page.locator(".calibration .hint")
    check("the calibration is described", visit.until(lambda: hint.inner_text() != ""), hint.inner_text())
    if not must_be_there and not link.is_visible():
        print("left out: the sheet, which does not exist for this calibration")
        return
    is_shown = visit.until(link.is_visible) is not None
    check("the sheet is offered", is_shown)
    if not is_shown:
        return
    visit.shot(folder, "calibration")
    with visit.context.expect_page() as opened:
        link.click()
    sheet = opened.value
    sheet.wait_for_load_state()
    check("the sheet is opened", "Calibration" in sheet.title(), sheet.title())
    check("in its own looks", sheet.evaluate("getComputedStyle(document.body).maxWidth") != "none")
    pictures.take(sheet, folder / "sheet.png")
    sheet.close()


def looks_at_cameras(visit, folder, has_sheet):
    page = visit.page
    page.keyboard.press("2")
    tiles = page.locator(".tile")
    check("every camera has a tile", tiles.count() > 0, tiles.count())
    opens_the_sheet(visit, folder, has_sheet)
    page.locator(".tile-open").first.click()
    page.wait_for_timeout(2000)
    visit.shot(folder, "cameras")
    page.select_option(".toolbar select", index=1)
    page.wait_for_timeout(1500)
    visit.shot(folder, "from-camera")
    page.keyboard.press("f")
    page.keyboard.press("3")
    page.wait_for_timeout(2500)
    check("every link has a card", page.locator(".links .card").count() > 0)
    visit.shot(folder, "links")
    page.keyboard.press("4")
    page.wait_for_timeout(800)
    visit.shot(folder, "events")
    page.keyboard.press("?")
    check("? lists the keys", page.locator("dialog.help").is_visible())
    visit.shot(folder, "keys")
    page.keyboard.press("Escape")
    page.keyboard.press("1")


def alarm_comes_and_goes(visit, folder):
    alarm = visit.page.locator(".alarm")
    came = visit.until(lambda: alarm.count() > 0)
    text = alarm.first.inner_text() if came is not None else ""
    check("an alarm comes in words", len(text.split()) > 4, repr(text))
    check("with a remedy", came is not None and visit.page.locator(".alarm-remedy").first.inner_text() != "")
    visit.shot(folder, "alarm")
    check("and goes", visit.until(lambda: alarm.count() == 0) is not None)


def scrubs(visit, folder):
    page = visit.page
    before = visit.counter("tick")
    page.keyboard.press("j")
    check("five seconds back is paused", visit.until(lambda: visit.counter("playback") == "paused") is not None)
    moved = visit.until(lambda: visit.counter("tick") < before)
    check("an earlier moment is shown", moved is not None, f"tick {before:.0f} -> {visit.counter('tick'):.0f}")
    at = visit.counter("tick")
    page.wait_for_timeout(1000)
    check("it stays", visit.counter("tick") == at)
    page.wait_for_timeout(8000)
    check("a pause is no absence", "away" not in page.locator(".pill").inner_text())
    page.keyboard.press(".")
    check("a step is a tick", visit.until(lambda: visit.counter("tick") == at + 1) is not None, visit.counter("tick") - at)
    visit.shot(folder, "scrubbed")
    page.keyboard.press(" ")
    check("it plays on", visit.until(lambda: visit.counter("tick") > at + 10) is not None)
    page.keyboard.press("l")
    is_live = visit.until(lambda: visit.counter("playback") == "live") is not None
    check("and is live again", is_live and visit.until(lambda: visit.counter("tick") > before) is not None)


def records(visit, folder):
    record = visit.page.locator(".record")
    if not record.is_visible():
        print("left out: recording, which the server does not offer without a token")
        return
    for is_running in (True, False):
        record.click()
        is_so = visit.until(lambda: ("on" in (record.get_attribute("class") or "").split()) == is_running)
        check(f"a recording {'starts' if is_running else 'stops'}", is_so is not None)
        if is_running:
            is_shown = visit.until(lambda: re.search(r"\d:\d\d · .*B", record.inner_text()) is not None)
            check("duration and size are shown", is_shown is not None, record.inner_text())
            visit.shot(folder, "recording")


def refuses_strangers(url):
    """A foreign page must not read anything, nor a host whose name was pointed here."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme != "http":
        print("left out: strangers, who are tried over http only")
        return
    socket = f"ws://{parts.netloc}/ws"

    async def opens(origin):
        try:
            async with websockets.connect(socket, origin=origin, open_timeout=10):
                return 101
        except websockets.exceptions.InvalidStatus as error:
            return error.response.status_code

    own = f"{parts.scheme}://{parts.netloc}"
    check("a WebSocket of the page's own origin is open", asyncio.run(opens(own)) == 101)
    foreign = asyncio.run(opens("http://stranger.example"))
    check("a WebSocket of a foreign origin is refused", foreign == 403, foreign)
    for host, wanted in ((parts.netloc, 200), ("stranger.example", 421)):
        connection = http.client.HTTPConnection(parts.hostname, parts.port, timeout=10)
        connection.request("GET", "/api/venue", headers={"Host": host})
        status = connection.getresponse().status
        check(f"Host {host} is answered {wanted}", status == wanted, status)
        connection.close()


def scrubs_on_a_phone(visit, folder):
    page, moment = visit.page, visit.page.locator(".time .place")
    check("phone: which moment it is stands there", visit.until(moment.is_visible) is not None, moment.inner_text())
    slider = page.locator(".time input")
    slider.evaluate("it => { it.value = it.max - 120; it.dispatchEvent(new Event('input')); it.dispatchEvent(new Event('change')); }")
    is_past = visit.until(lambda: re.match(r"−\d+:\d\d\.\d", moment.inner_text()) is not None)
    check("phone: and of the past how long ago", is_past is not None, moment.inner_text())
    box, line = moment.bounding_box(), slider.bounding_box()
    fits = box and line and box["y"] + box["height"] <= line["y"] + 1 and box["y"] + box["height"] <= page.viewport_size["height"]
    check("phone: above the slider", fits, f"{box} {line}")
    visit.shot(folder, "phone-past")


def looks(browser, url, folder):
    """Light mode, and a phone: for inspection by eye."""
    light = Visit(browser, url, viewport={"width": 1280, "height": 720}, color_scheme="light")
    phone = Visit(browser, url, viewport={"width": 390, "height": 844}, device_scale_factor=2, is_mobile=True, has_touch=True)
    for visit, name in ((light, "field-light"), (phone, "phone")):
        visit.page.bring_to_front()
        check(f"{name}: people are drawn", visit.until(lambda v=visit: (v.counter("persons") or 0) > 0) is not None)
        visit.page.wait_for_timeout(2500)
        visit.shot(folder, name)
        wide = visit.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        check(f"{name}: nothing sticks out to the side", wide <= 0, f"{wide} px")
        if name == "phone":
            scrubs_on_a_phone(visit, folder)
        check(f"{name}: no console errors", not visit.console, visit.console[:3] or "")
        visit.context.close()


class Server:
    """A command that serves the page, and the address that it prints."""

    def __init__(self, command):
        self.command = command
        self.process = subprocess.Popen(shlex.split(command), stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            if found := re.search(r"https?://\S+", line):
                self.url = found.group(0)
                # Later output must not fill the pipe.
                threading.Thread(target=self.process.stdout.read, daemon=True).start()
                return
        raise SystemExit(f"{command}: ended with {self.process.wait()} and without an address")

    def stop(self):
        self.process.terminate()
        self.process.wait(timeout=20)

    def end(self):
        """Interrupts it as Ctrl-C does; open pages must show the end."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(timeout=20)


def comes_back(browser, server, folder):
    """The server ends and starts again: another session, another token."""
    visit = Visit(browser, server.url, viewport={"width": 1280, "height": 720}, color_scheme="dark")
    check("people are drawn", visit.until(lambda: (visit.counter("persons") or 0) > 0) is not None)
    server.stop()
    pill = visit.page.locator(".pill")
    is_away = visit.until(lambda: pill.inner_text() == "Fusion is away") is not None
    check("the page says that fusion is away", is_away, pill.inner_text())
    check("and what to do", "farfield status" in visit.page.locator(".alarm").first.inner_text())
    visit.page.wait_for_timeout(1000)
    visit.shot(folder, "away")
    ticks = visit.counter("ticks")
    again = Server(server.command)
    try:
        is_back = visit.until(lambda: visit.counter("ticks") > ticks and pill.inner_text() != "Fusion is away")
        check("and comes back by itself", is_back is not None, f"after {is_back or 0:.1f} s")
        check("nothing could not be read", visit.counter("unreadable") == "", visit.counter("unreadable"))
        again.end()
        check("the end of a run is shown", visit.until(lambda: pill.inner_text() == "The run has ended") is not None, pill.inner_text())
        check("and is no failure", visit.page.locator(".alarm.failed").count() == 0 and visit.page.locator(".alarm.note").count() == 1)
        visit.page.wait_for_timeout(1000)
        visit.shot(folder, "ended")
    finally:
        again.stop()
    visit.context.close()


def replays(browser, command, folder):
    """A replay: with people and events, and without claims about links and cameras."""
    server = Server(f"{command} --replay")
    visit = Visit(browser, server.url, viewport={"width": 1280, "height": 720}, color_scheme="dark")
    try:
        page = visit.page
        check("people of a replay are drawn", visit.until(lambda: (visit.counter("persons") or 0) > 0) is not None)
        page.wait_for_timeout(1500)
        pill, views = page.locator(".pill"), page.locator(".person .views")
        check("a replay says what it is", pill.inner_text() == "Replay", pill.inner_text())
        check("no viewpoint is struck out as gone", views.locator("i").count() == 0 and "viewpoint" in views.first.inner_text(), views.first.inner_text())
        place = page.locator(".time .place")
        check("its moments are times of the recording", re.match(r"\d+:\d\d\.\d ", place.inner_text()) is not None, place.inner_text())
        visit.shot(folder, "replay")
        page.keyboard.press("2")
        check("no camera has a verdict", page.locator(".tile").count() > 0 and page.locator(".tile .lamp:visible").count() == 0)
        page.wait_for_timeout(1500)
        visit.shot(folder, "replay-cameras")
        page.keyboard.press("3")
        check("links have no figures", "farfield view" in page.locator("#panel-links").inner_text())
        check("replay: no console errors", not visit.console, visit.console[:3] or "")
    finally:
        server.stop()
        visit.context.close()


def visit_all(url, folder, people, server=None):
    folder.mkdir(parents=True, exist_ok=True)
    refuses_strangers(url)
    with sync_playwright() as playwright:
        chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        visit = Visit(browser, url, viewport={"width": 1280, "height": 720}, color_scheme="dark")
        people_are_drawn(visit, folder, people)
        follows(visit, folder)
        guesses(visit)
        names(visit)
        looks_at_cameras(visit, folder, has_sheet=server is not None)
        alarm_comes_and_goes(visit, folder)
        scrubs(visit, folder)
        records(visit, folder)
        draws_quickly(visit)
        check("the token is not in the address bar", "token" not in visit.page.url, visit.page.url)
        check("no console errors", not visit.console, visit.console[:3] or "")
        visit.context.close()
        looks(browser, url, folder)
        if server is not None:
            comes_back(browser, server, folder)
            replays(browser, server.command, folder)
        browser.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("shots", type=pathlib.Path)
    parser.add_argument("--people", type=int, default=1)
    parser.add_argument("--start")
    options = parser.parse_args()
    server = Server(options.start) if options.start else None
    try:
        visit_all(server.url if server else options.url, options.shots, options.people, server)
    finally:
        if server:
            server.stop()
    if failures:
        print(f"{len(failures)} failed: {'; '.join(failures)}")
        sys.exit(1)


if __name__ == "__main__":
    main()
