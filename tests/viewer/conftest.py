"""A served viewer, and a browser that looks at it where there is one."""

import shutil
import time
from importlib.util import find_spec

import pytest

import tmca

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="session")
def browser():
    """Chromium without a window."""
    if CHROMIUM is None or find_spec("playwright") is None:
        pytest.skip("needs chromium and playwright")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as running:
        started = running.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage"]
        )
        yield started
        started.close()


class Looked:
    """A page that is open in the browser."""

    def __init__(self, page, viewer):
        self.page, self.viewer, self.errors = page, viewer, []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def ask(self, script):
        """What JavaScript says on the page."""
        return self.page.evaluate(script)

    def until(self, script, seconds=30):
        """Wait until JavaScript says something true."""
        end = time.monotonic() + seconds
        while not (said := self.ask(script)):
            assert time.monotonic() < end, f"{script} after {seconds} s, {self.errors}, {self.message}"
            self.page.wait_for_timeout(20)
        return said

    @property
    def message(self):
        """What the page says at the bottom."""
        return self.ask("document.getElementById('message').textContent")


@pytest.fixture
def look(browser):
    """``look(things, truth=…)`` opens them on a page; ``address`` opens another one."""
    opened = []

    def start(*things, hash="", address=None, size=(1150, 760), **how):
        viewer = None if address else tmca.view(*things, **how)
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        opened.append((page, viewer))
        looked = Looked(page, viewer)
        page.goto((address or viewer.address) + hash)
        looked.until("Boolean(window.tmca?.desk) && tmca.frames > 0")
        return looked

    yield start
    for page, viewer in opened:
        page.close()
        if viewer is not None:
            viewer.close()
