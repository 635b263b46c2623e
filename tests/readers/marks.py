"""Opens the page of `farfield calibrate marks` in Debian's Chromium and clicks like an operator.

    pip install playwright
    python tests/readers/marks.py FARFIELD SHOTS

FARFIELD is the program; SHOTS the folder for images, screenshots and the file of clicks. An invented camera shows a futsal court:
its image is drawn here, so that the truth is known. Chromium is /usr/bin/chromium, or $CHROMIUM. Prints a line per check; exits
with 1 if one failed.
"""

import argparse
import math
import os
import pathlib
import re
import struct
import subprocess
import sys
import threading
import time
import tomllib
import zlib

import pictures
from playwright.sync_api import sync_playwright

PATIENCE_S = 60
SIZE = (1280, 720)
FOCAL_PX = 640.0
# Radial distortion: straight lines of the court are not straight in the image.
K1 = -0.06
# Position and target of the camera, metres; another one stands at the opposite corner.
CAMERAS = {"north": ((-10.0, 20.0, 8.0), (-8.0, 2.0, 0.0)), "south": ((10.0, -20.0, 8.0), (8.0, -2.0, 0.0))}

failures = []


def check(what, is_right, found=""):
    print(f"{'ok' if is_right else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not is_right:
        failures.append(what)


def cross(a, b):
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return tuple(x / length for x in a)


class Camera:
    def __init__(self, centre, target):
        forward = unit(tuple(t - c for t, c in zip(target, centre)))
        right = unit(cross(forward, (0.0, 0.0, 1.0)))
        self.centre, self.rows = centre, (right, cross(forward, right), forward)

    def seen(self, at):
        """Distorted pixels of a point, None behind the camera or far outside."""
        arm = tuple(a - c for a, c in zip(at, self.centre))
        x, y, z = (sum(r * a for r, a in zip(row, arm)) for row in self.rows)
        if z < 0.5:
            return None
        x, y = x / z, y / z
        r2 = x * x + y * y
        if r2 > 2.0:
            return None
        bent = 1 + K1 * r2
        return FOCAL_PX * x * bent + (SIZE[0] - 1) / 2, FOCAL_PX * y * bent + (SIZE[1] - 1) / 2

    def toml(self, name):
        r = self.rows
        trace = r[0][0] + r[1][1] + r[2][2]
        angle = math.acos(max(-1.0, min(1.0, (trace - 1) / 2)))
        axis = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1])
        turn = [a * angle / (2 * math.sin(angle)) for a in axis]
        shift = [-sum(a * c for a, c in zip(row, self.centre)) for row in r]
        cx, cy = (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2
        return (
            f'[{name}]\nname = "{name}"\nsize = [{SIZE[0]}, {SIZE[1]}]\n'
            f"matrix = [[{FOCAL_PX}, 0.0, {cx}], [0.0, {FOCAL_PX}, {cy}], [0.0, 0.0, 1.0]]\n"
            f"distortions = [{K1}, 0.0, 0.0, 0.0, 0.0]\nrotation = {turn}\ntranslation = {shift}\n\n"
        )


def arc(cx, cy, radius, start, by):
    return [(cx + radius * math.cos(start + by * i / 60), cy + radius * math.sin(start + by * i / 60)) for i in range(61)]


def court():
    """The lines of a futsal court, 40 x 20 m, as points on the floor."""
    def straight(ax, ay, bx, by):
        return [(ax + (bx - ax) * i / 80, ay + (by - ay) * i / 80) for i in range(81)]

    lines = [straight(-20, y, 20, y) for y in (-10, 10)] + [straight(x, -10, x, 10) for x in (-20, 0, 20)]
    lines.append(arc(0, 0, 3, 0, 2 * math.pi))
    for sign in (-1, 1):
        lines.append(straight(sign * 14, -1.58, sign * 14, 1.58))
        for side in (-1, 1):
            start = (0 if side > 0 else -math.pi / 2) if sign < 0 else (math.pi / 2 if side > 0 else math.pi)
            lines.append(arc(sign * 20, side * 1.58, 6, start, math.pi / 2))
    return lines


def draw(camera, path):
    """A grey floor with white lines of 8 cm, in the camera's image."""
    width, height = SIZE
    rows = [bytearray() for _ in range(height)]
    for y in range(height):
        shade = 70 + 50 * y // height
        rows[y] = bytearray((shade, shade + 14, shade + 22) * width)
    for points in court():
        seen = [camera.seen((x, y, 0.0)) for x, y in points]
        for (a, b), at in zip(zip(seen, seen[1:]), points):
            if a is None or b is None:
                continue
            away = math.dist((*at, 0.0), camera.centre)
            thick = max(0.7, 0.04 * FOCAL_PX / away)
            steps = int(max(abs(b[0] - a[0]), abs(b[1] - a[1]))) * 2 + 1
            for i in range(steps + 1):
                x, y = a[0] + (b[0] - a[0]) * i / steps, a[1] + (b[1] - a[1]) * i / steps
                for v in range(math.floor(y - thick), math.ceil(y + thick) + 1):
                    for u in range(math.floor(x - thick), math.ceil(x + thick) + 1):
                        cover = thick + 0.5 - math.hypot(u - x, v - y)
                        if cover > 0 and 0 <= u < width and 0 <= v < height:
                            for c in range(3):
                                rows[v][3 * u + c] = max(rows[v][3 * u + c], int(235 * min(1.0, cover)))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    raw = b"".join(b"\0" + bytes(row) for row in rows)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b""))


class Command:
    def __init__(self, words):
        self.process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
        self.output = ""
        for line in self.process.stderr:
            self.output += line
            if found := re.search(r"https?://\S+", line):
                self.url = found.group(0)
                threading.Thread(target=self.process.stderr.read, daemon=True).start()
                return
        raise SystemExit(f"{words}: ended with {self.process.wait()}:\n{self.output}")

    def stop(self):
        self.process.send_signal(2)
        return self.process.wait(timeout=20)


MARKS = {
    "corner_north_west": (-20.0, 10.0, 0.0),
    "halfway_north": (0.0, 10.0, 0.0),
    "penalty_spot_west": (-14.0, 0.0, 0.0),
    "centre": (0.0, 0.0, 0.0),
    "centre_circle_north": (0.0, 3.0, 0.0),
    "centre_circle_south": (0.0, -3.0, 0.0),
}


class Page:
    def __init__(self, browser, url, **context):
        self.context = browser.new_context(**context)
        self.page = self.context.new_page()
        self.console = []
        self.page.on("console", lambda m: self.console.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.console.append(str(error)))
        self.page.goto(url)

    def number(self, name):
        return self.page.evaluate(f"window.farfieldMarks ? window.farfieldMarks.{name} : null")

    def until(self, is_so, patience_s=PATIENCE_S):
        began = time.monotonic()
        while time.monotonic() - began < patience_s:
            if is_so():
                return True
            self.page.wait_for_timeout(50)
        return False

    def on_screen(self, px):
        """Position of a pixel while the whole image is shown: its corner is half a pixel from its number."""
        box = self.page.locator("canvas.picture").bounding_box()
        scale = min(box["width"] / SIZE[0], box["height"] / SIZE[1])
        left = box["x"] + (box["width"] - scale * SIZE[0]) / 2
        top = box["y"] + (box["height"] - scale * SIZE[1]) / 2
        return left + (px[0] + 0.5) * scale, top + (px[1] + 0.5) * scale

    def choose(self, name):
        self.page.locator(".mark-name", has_text=re.compile(f"^{name.replace('_', ' ')}$")).first.click()

    def click(self, name, px, is_tapped=False):
        """Clicks in the list and in the image."""
        self.choose(name)
        at = self.on_screen(px)
        if is_tapped:
            self.page.touchscreen.tap(*at)
        else:
            self.page.mouse.click(*at)

    def shot(self, folder, name):
        self.page.mouse.move(5, 5)
        self.page.wait_for_timeout(400)
        pictures.take(self.page, folder / f"{name}.png")


def clicked(path):
    return tomllib.loads(path.read_text())["camera"]


def clicks_four_corners(visit, folder, out, camera):
    page = visit.page
    check("the picture comes", visit.until(lambda: not page.locator(".pictures .waiting").is_visible()))
    check("the first mark is lit", visit.number("next") is not None, visit.number("next"))
    visit.shot(folder, "marks-empty")
    for count, (name, at) in enumerate(MARKS.items(), 1):
        visit.click(name, camera.seen(at))
        if count == 3:
            page.wait_for_timeout(300)
            check("below four marks nothing is drawn", visit.number("drawnLines") == 0)
        if count == 4:
            check("from four marks on the court is drawn", visit.until(lambda: visit.number("drawnLines") > 5), visit.number("drawnLines"))
    check("every click is counted", visit.number("clicks") == len(MARKS), visit.number("clicks"))
    check("and saved", visit.until(lambda: visit.number("isSaved")))
    found = clicked(out)["north"]
    for name, at in MARKS.items():
        off = math.dist(found[name], camera.seen(at))
        check(f"{name} is in the file where it was clicked", off < 0.5, f"{off:.2f} px off")
    verdict = page.locator(".verdict-text").inner_text()
    check("the position of the camera is shown", "clicks fit to" in verdict, verdict)
    place = [float(v) for v in re.search(r"\(([-\d.]+), ([-\d.]+), ([-\d.]+)\)", verdict).groups()]
    apart = math.dist(place, CAMERAS["north"][0])
    check("and is where it stands", apart < 1.0, f"{apart:.2f} m off")
    check("the symmetry of the court is shown", "turned by half" in page.locator(".verdict").inner_text())
    visit.shot(folder, "marks-fitted")


def corrects(visit, folder, out, camera):
    """A wrong corner is reported; drag, arrow keys, undo, delete."""
    page = visit.page
    right = camera.seen(MARKS["centre"])
    page.mouse.move(*visit.on_screen(clicked(out)["north"]["centre"]))
    page.mouse.down()
    page.mouse.move(*visit.on_screen((right[0] + 60, right[1] - 30)), steps=6)
    page.mouse.up()
    bad = page.locator(".mark-chip .bad")
    check("a mark that is dragged away shows as wrong", visit.until(lambda: bad.count() > 0), page.locator(".verdict-text").inner_text())
    visit.shot(folder, "marks-wrong")
    page.keyboard.press("Control+z")
    check("undone it is right again", visit.until(lambda: bad.count() == 0 and visit.number("isSaved")))
    page.locator(".mark-row", has=page.locator(".mark-name", has_text=re.compile("^centre$"))).locator(".mark-chip button").first.click()
    before = clicked(out)["north"]["centre"]
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowDown"):
        page.keyboard.press(key)
    moved = lambda: [round(a - b, 2) for a, b in zip(clicked(out)["north"]["centre"], before)]
    check("arrow keys move by tenths of a pixel, with Shift by one", visit.until(lambda: moved() == [0.2, 1.0]), moved())
    page.keyboard.press("Delete")
    check("Delete takes it away", visit.until(lambda: "centre" not in clicked(out)["north"]))
    # A run of arrow keys is undone as one.
    for _ in range(2):
        page.keyboard.press("Control+z")
    check("and undo brings all back", visit.until(lambda: clicked(out)["north"].get("centre") == before))


def cannot_go_wrong(visit, out):
    """Clicks that no file may contain are not possible in the page, and changes by others are not overwritten."""
    page = visit.page
    before = clicked(out)["north"]["centre"]
    canvas = page.locator("canvas.picture").bounding_box()
    page.keyboard.press("0")
    page.mouse.move(*visit.on_screen(before))
    page.mouse.down()
    page.mouse.move(canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] + 30, steps=6)
    page.mouse.up()
    at_edge = lambda: visit.number("isSaved") and clicked(out)["north"]["centre"][1] == SIZE[1] - 0.5
    check("a mark that is dragged out of the picture stays at its edge", visit.until(at_edge), clicked(out)["north"]["centre"])
    page.keyboard.press("Control+z")
    check("and comes back", visit.until(lambda: clicked(out)["north"]["centre"] == before))
    touch = page.context.new_cdp_session(page)
    x, y = visit.on_screen(before)
    for kind, points in (
        ("touchStart", [(x, y)]),
        ("touchMove", [(x + 40, y)]),
        ("touchStart", [(x + 40, y), (x + 120, y)]),
        ("touchMove", [(x + 20, y), (x + 160, y)]),
        ("touchEnd", []),
    ):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": a, "y": b, "id": i} for i, (a, b) in enumerate(points)]})
        page.wait_for_timeout(100)
    page.wait_for_timeout(500)
    check("two fingers on a mark move the picture and not the mark", clicked(out)["north"]["centre"] == before, clicked(out)["north"]["centre"])
    page.keyboard.press("0")
    text = out.read_text()
    by_hand = text + "# looked at by hand\n"
    out.write_text(by_hand)
    page.locator(".mark-row", has=page.locator(".mark-name", has_text=re.compile("^centre$"))).locator(".mark-chip button").first.click()
    page.keyboard.press("ArrowRight")
    task = lambda: page.locator(".task").inner_text()
    check("a file that was edited by hand is reloaded", visit.until(lambda: "changed elsewhere" in task()), task())
    check("and not written over", out.read_text() == by_hand)
    page.keyboard.press("Control+z")
    check("undo brings the own clicks back", visit.until(lambda: clicked(out)["north"]["centre"] != before and visit.number("isSaved")))
    page.keyboard.press("Control+z")
    check("and takes them back", visit.until(lambda: clicked(out)["north"]["centre"] == before))
    check("the file with the comment is kept", out.with_suffix(".before.toml").read_text() == by_hand)
    # Chromium itself logs an answer with 409, which is expected once, for the file that was edited by hand.
    meant = "Failed to load resource: the server responded with a status of 409 (Conflict)"
    check("one change was behind the file", visit.console.count(meant) == 1, visit.console)
    visit.console = [line for line in visit.console if line != meant]


def clicks_lines_and_names(visit, out, camera):
    page = visit.page
    page.keyboard.press("0")
    for x in (-9.0, -3.0):
        visit.click("touchline_north", camera.seen((x, 10.0, 0.0)))
    is_line = visit.until(lambda: len(clicked(out)["north"].get("touchline_north", [])) == 2)
    check("a line takes several clicks", is_line)
    form = page.locator(".adding")
    form.locator("input").nth(0).fill("door post")
    form.locator("input").nth(2).fill("-8.0, 4.0, 0")
    form.locator("button").click()
    page.mouse.click(*visit.on_screen(camera.seen((-8.0, 4.0, 0.0))))
    check("a place of one's own is clicked", visit.until(lambda: "door post" in clicked(out)["north"]))
    check("and tells which end is which", visit.until(lambda: "turned by half" not in page.locator(".verdict").inner_text()))
    form.locator("select").select_option("floor")
    form.locator("input").nth(0).fill("scratch")
    form.locator("button").click()
    page.mouse.click(*visit.on_screen(camera.seen((-5.0, 2.0, 0.0))))
    shown = lambda: page.locator(".file").inner_text()
    check("missing parts of --marks are shown", visit.until(lambda: "scratch" in shown() and "Not yet" in shown()), shown())


def zooms(visit, folder, camera):
    page = visit.page
    page.mouse.move(*visit.on_screen(camera.seen(MARKS["penalty_spot_west"])))
    for _ in range(6):
        page.mouse.wheel(0, -240)
    page.wait_for_timeout(400)
    pictures.take(page, folder / "marks-near.png")
    page.keyboard.press("0")
    page.keyboard.press("?")
    check("? says how to click", page.locator("dialog.help").is_visible())
    visit.shot(folder, "marks-help")
    page.keyboard.press("Escape")


def looks(browser, url, folder, camera):
    light = Page(browser, url, viewport={"width": 1280, "height": 720}, color_scheme="light")
    phone = Page(browser, url, viewport={"width": 390, "height": 844}, device_scale_factor=2, is_mobile=True, has_touch=True)
    for visit, name in ((light, "marks-light"), (phone, "marks-phone")):
        check(f"{name}: what was clicked is there", visit.until(lambda v=visit: (v.number("clicks") or 0) >= len(MARKS)))
        visit.until(lambda v=visit: not v.page.locator(".pictures .waiting").is_visible())
        visit.page.wait_for_timeout(800)
        pictures.take(visit.page, folder / f"{name}.png")
        wide = visit.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        check(f"{name}: nothing sticks out to the side", wide <= 0, f"{wide} px")
    before = phone.number("clicks")
    phone.page.evaluate("scrollTo(0, 0)")
    at = phone.on_screen(camera.seen((4.0, 5.0, 0.0)))
    phone.page.touchscreen.tap(*at)
    check("a tap clicks", phone.until(lambda: phone.number("clicks") == before + 1), phone.number("next"))
    for visit in (light, phone):
        check("no console errors", not visit.console, visit.console[:3] or "")
        visit.context.close()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("farfield")
    parser.add_argument("shots", type=pathlib.Path)
    options = parser.parse_args()
    folder = options.shots
    pictures = folder / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    cameras = {name: Camera(*place) for name, place in CAMERAS.items()}
    for name, camera in cameras.items():
        draw(camera, pictures / f"{name}.png")
    lens = folder / "lenses.toml"
    lens.write_text("".join(camera.toml(name) for name, camera in cameras.items()))
    out = folder / "clicked.toml"
    for path in (out, *folder.glob("clicked.before*.toml")):
        path.unlink(missing_ok=True)
    words = [options.farfield, "calibrate", "marks", str(pictures), "--court", "futsal", "--lens", str(lens)]
    command = Command([*words, "--out", str(out), "--at", "127.0.0.1:0"])
    try:
        with sync_playwright() as playwright:
            chromium = os.environ.get("CHROMIUM", "/usr/bin/chromium")
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            visit = Page(browser, command.url, viewport={"width": 1280, "height": 720}, color_scheme="dark")
            camera = cameras["north"]
            clicks_four_corners(visit, folder, out, camera)
            corrects(visit, folder, out, camera)
            cannot_go_wrong(visit, out)
            clicks_lines_and_names(visit, out, camera)
            zooms(visit, folder, camera)
            check("the token is not in the address bar", "token" not in visit.page.url, visit.page.url)
            check("no console errors", not visit.console, visit.console[:3] or "")
            visit.context.close()
            stranger = Page(browser, command.url.split("#")[0], viewport={"width": 800, "height": 600})
            waiting = stranger.page.locator(".waiting")
            is_shown = stranger.until(lambda: "printed" in waiting.inner_text())
            check("a client without the token gets an explanation", is_shown, waiting.inner_text())
            stranger.context.close()
            looks(browser, command.url, folder, camera)
            browser.close()
    finally:
        code = command.stop()
    check("Ctrl-C ends it well", code == 0, code)
    check("and the file stays whole", "centre" in clicked(out)["north"])
    if failures:
        print(f"{len(failures)} failed: {'; '.join(failures)}")
        sys.exit(1)


if __name__ == "__main__":
    main()
