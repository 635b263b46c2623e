"""Screenshots of a page, for inspection by eye.

A browser without a graphics card now and then says "Unable to capture screenshot" of a page that has just been opened or
is behind another one: it is brought to the front, and asked again.
"""

from playwright.sync_api import Error

TRIES = 10
PAUSE_MS = 500


def take(page, path, **options):
    """Writes what `page` shows to `path`.

    Raises the browser's last error if it gives no image for some seconds.
    """
    for left in reversed(range(TRIES)):
        try:
            page.bring_to_front()
            page.screenshot(path=str(path), **options)
            return
        except Error:
            if left == 0:
                raise
            page.wait_for_timeout(PAUSE_MS)
