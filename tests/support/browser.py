"""Pages in headless Chromium, which may ask this machine for what they need and no other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from support.tools import HANGING, tool

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

# Software rendering draws WebGL where there is no graphics card.
OPTIONS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--disable-background-networking"]


@dataclass
class Visit:
    """An open page, and what went wrong while it was open."""

    page: Page
    foreign: list[str] = field(default_factory=list)
    """Addresses of other machines that the page asked for, none of which it got."""
    faults: list[str] = field(default_factory=list)
    """Exceptions of scripts that nothing caught, and errors in the console."""


@contextmanager
def visit(address: str, width: int = 1280, height: int = 800) -> Iterator[Visit]:
    """Open an address, of a file or a server on this machine, in a window of a size in pixels."""
    # Late, as the default run has no Playwright.
    from playwright.sync_api import expect, sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=tool("chromium"), args=OPTIONS)
        try:
            page = browser.new_page(viewport={"width": width, "height": height})
            page.set_default_timeout(1e3 * HANGING)
            expect.set_options(timeout=1e3 * HANGING)
            seen = Visit(page)

            def pass_or_block(route: Route) -> None:
                """Requests to this machine pass, the others are written down and blocked."""
                parts = urlsplit(route.request.url)
                local = parts.hostname in (None, "", "localhost", "127.0.0.1")
                if not local:
                    seen.foreign.append(route.request.url)
                (route.continue_ if local else route.abort)()

            page.route("**/*", pass_or_block)
            page.on("pageerror", lambda error: seen.faults.append(str(error)))
            page.on("console", lambda x: seen.faults.append(x.text) if x.type == "error" else None)
            page.goto(address)
            yield seen
        finally:
            browser.close()
