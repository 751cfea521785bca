"""A page in a real browser, and the problems that it had there."""

import shutil
from contextlib import contextmanager

import pytest

#: Names of Chromium and its relatives on the path.
BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
)


@contextmanager
def launched_browser():
    """A running Chromium, found on the path, or else Playwright's own; it is closed at the end.

    Without any of them the test is skipped, with the reason.
    """
    sync_api = pytest.importorskip("playwright.sync_api")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)  # None is Playwright's own
    with sync_api.sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        except sync_api.Error as error:
            pytest.skip(
                f"no browser: none of {', '.join(BROWSERS)} on the path, nor Playwright's own "
                f"({str(error).splitlines()[0]})"
            )
        yield browser
        browser.close()


class BrowserPage:
    """A page of a file in a browser, in a window of some width in pixels.

    `problems` has errors and warnings on its console, and addresses that it asks for and that are
    not part of the file.
    """

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
