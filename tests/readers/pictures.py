"""Pictures of a page, for people to look at: no check hangs on them.

A browser without a graphics card now and then says "Unable to capture screenshot" of a page that has just been opened or
is behind another one: it is brought to the front, and asked again.
"""

from playwright.sync_api import Error

TRIES = 5
PAUSE_MS = 500


def take(page, path, **options):
    """Writes what `page` shows to `path`; says so where the browser cannot after all."""
    for _ in range(TRIES):
        try:
            page.bring_to_front()
            page.screenshot(path=str(path), **options)
            return
        except Error as error:
            why = str(error).splitlines()[0]
            page.wait_for_timeout(PAUSE_MS)
    print(f"left out: {path.name}, of which the browser makes no picture ({why})", flush=True)
