"""A page in a real browser, and what went wrong in it."""

import shutil
from contextlib import contextmanager

import pytest

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
)


@contextmanager
def launched():
    """Chromium, wherever it is: on the path, or Playwright's own.

    Without one the test is skipped and says so.
    """
    sync_api = pytest.importorskip("playwright.sync_api")
    observed = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_api.sync_playwright() as playwright:
        try:
            opened = playwright.chromium.launch(executable_path=observed, args=["--no-sandbox"])
        except sync_api.Error as error:
            pytest.skip(
                f"no browser: none of {', '.join(BROWSERS)} on the path, nor Playwright's own "
                f"({str(error).splitlines()[0]})"
            )
        yield opened
        opened.close()


class Opened:
    """A page of a file; what it says on the console and asks of the network are its problems."""

    def __init__(self, browser, path, width, **options):
        self.problems = []
        self.page = browser.new_page(viewport={"width": width, "height": 900}, **options)
        self.page.set_default_timeout(200_000)  # milliseconds, for a busy machine
        self.page.on("console", self.note_message)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", self.note_request)
        self.page.goto(path.as_uri())

    def note_message(self, message):
        if message.type in ("error", "warning"):
            self.problems.append(message.text)

    def note_request(self, request):
        if not request.url.startswith(("file:", "data:", "blob:")):
            self.problems.append(request.url)

    def page_width(self):
        """Pixels that the page takes: if the window has fewer, the reader scrolls sideways."""
        return self.page.evaluate("document.documentElement.scrollWidth")
