"""A served dashboard over a database of the test's, and a browser page that tolerates no fault."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from service.settings import Settings
from tests.browser.chromium import LAPTOP, missing, running_chromium
from tests.builders.databases import migrated_sqlite, sqlite_database
from tests.builders.server import Server
from tests.builders.web import settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["migrated_sqlite", "settings", "sqlite_database"]


@dataclass
class Faults:
    """What a page did wrong. `is_server_away`: connections may fail for a while."""

    found: list[str] = field(default_factory=list)
    is_server_away: bool = False

    def watch(self, page: Page, url: str) -> None:
        host = urlsplit(url).netloc
        # A violation of the policy is a console error, too; so is a file that is not found.
        page.on(
            "console",
            lambda told: self._add(
                f"console {told.type}: {told.text} ({told.location.get('url', '')})", told.type
            ),
        )
        page.on("pageerror", lambda error: self.found.append(f"script: {error}"))

        def check(address: str) -> None:
            parts = urlsplit(address)
            if parts.scheme not in ("data", "blob") and parts.netloc != host:
                self.found.append(f"outside request: {address}")

        page.on("request", lambda request: check(request.url))

    def _add(self, text: str, kind: str) -> None:
        # A test that looks at a 3D view reads its pixels, which the driver calls slow.
        is_expected = (self.is_server_away and "net::ERR_" in text) or "stall due to ReadPixels" in text
        # A report stands alone: it names no icon, and the browser looks for one by itself.
        is_expected = is_expected or "/favicon.ico" in text
        if kind in ("error", "warning") and not is_expected:
            self.found.append(text)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    reason = missing()
    if reason is not None:
        # A browser is not among what a fresh machine has; `missing` says what to install.
        pytest.skip(f"browser tests: {reason}")
    with running_chromium() as found:
        yield found


@pytest.fixture
def server(settings: Settings) -> Iterator[Server]:
    made = Server(settings)
    made.start()
    yield made
    made.stop()


@pytest.fixture
def faults() -> Faults:
    return Faults()


@pytest.fixture
def page(browser: Browser, server: Server, faults: Faults) -> Iterator[Page]:
    """A page of a laptop's size; at the end of the test it must have been without fault."""
    context = browser.new_context(
        viewport={"width": LAPTOP[0], "height": LAPTOP[1]}, base_url=server.url, reduced_motion="reduce"
    )
    made = context.new_page()
    made.set_default_timeout(60_000)
    faults.watch(made, server.url)
    yield made
    context.close()
    assert faults.found == []
