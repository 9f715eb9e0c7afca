"""What a page costs: `python -m tests.browser.page_figures [--designs 500] [--grains 10000,300000]`.

For a study of so many designs and charges of so many grains: bytes over the wire, requests, SQL statements until
loaded, first paint, end of loading, and processor time of the page thread, as chromium tells; for grains
also when they were drawn. Chromium draws in software here. Times belong to this machine and its load.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.table import Table
from sqlalchemy import event

from service.db.migrate import upgrade
from service.db.session import Database
from service.settings import Settings
from tests.browser.chromium import LAPTOP, missing, running_chromium
from tests.builders.analyses import a_scattered_study
from tests.builders.scenes import a_charge_with_grains
from tests.builders.server import Server

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

LONGEST_MS = 300_000
DRAWN = "() => [...document.querySelectorAll('[data-scene]')].every((box) => box.dataset.drawn !== undefined)"
PAINT = "() => performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
LOADED = "() => performance.getEntriesByType('navigation')[0].loadEventEnd"


class Figures(NamedTuple):
    """Of one load: bytes and requests over the wire, SQL statements, and times since its start, s."""

    name: str
    bytes: int
    requests: int
    statements: int
    first_paint: float
    loaded: float
    busy: float
    drawn: float | None


@contextmanager
def counted_statements(server: Server) -> Iterator[list[str]]:
    """The SQL statements of the service meanwhile."""
    seen: list[str] = []

    def count(_connection: Any, _cursor: Any, statement: str, *_rest: Any) -> None:
        seen.append(statement)

    engine = server.app.state.database.engine
    event.listen(engine, "before_cursor_execute", count)
    try:
        yield seen
    finally:
        event.remove(engine, "before_cursor_execute", count)


def figures_of(browser: Browser, server: Server, name: str, path: str, has_grains: bool = False) -> Figures:
    """Of one page in a fresh browser context, which has nothing stored."""
    context = browser.new_context(viewport={"width": LAPTOP[0], "height": LAPTOP[1]})
    page = context.new_page()
    page.set_default_timeout(LONGEST_MS)
    sizes: list[int] = []
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    session.on("Network.loadingFinished", lambda told: sizes.append(int(told["encodedDataLength"])))
    with counted_statements(server) as statements:
        started = time.monotonic()
        page.goto(f"{server.url}{path}", wait_until="load")
        until_loaded = len(statements)
        drawn = _wait_for_grains(page, started) if has_grains else None
        page.wait_for_timeout(1500)
    found = Figures(
        name,
        sum(sizes),
        len(sizes),
        until_loaded,
        (page.evaluate(PAINT) or 0.0) / 1000.0,
        page.evaluate(LOADED) / 1000.0,
        next(
            m["value"]
            for m in session.send("Performance.getMetrics")["metrics"]
            if m["name"] == "TaskDuration"
        ),
        drawn,
    )
    context.close()
    return found


def _wait_for_grains(page: Page, started: float) -> float:
    page.wait_for_function(DRAWN)
    return time.monotonic() - started


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status: 1 without a browser."""
    parser = argparse.ArgumentParser(prog="python -m tests.browser.page_figures")
    parser.add_argument("--designs", type=int, default=500)
    parser.add_argument("--grains", default="10000,300000", help="of charges with four frames")
    given = parser.parse_args(arguments)
    reason = missing()
    if reason is not None:
        print(reason, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder, running_chromium() as browser:
        settings = Settings(data_dir=Path(folder))
        upgrade(settings.resolved_database_url)
        database = Database(settings.resolved_database_url)
        study = a_scattered_study(database, given.designs)
        pages = [
            ("start page", "/", False),
            (f"study of {given.designs} designs", f"/studies/{study}", False),
            ("its analysis", f"/studies/{study}/analysis", False),
        ]
        for count in (int(text) for text in given.grains.split(",")):
            charge = a_charge_with_grains(database, settings, count=count)
            pages.append((f"charge of {count} grains", f"/charges/{charge}", True))
        server = Server(settings)
        server.start()
        rows = [figures_of(browser, server, *page) for page in pages]
        server.stop()
        database.dispose()
    table = Table(
        "page", "MB", "requests", "statements", "paint, s", "loaded, s", "busy, s", "drawn, s", box=None
    )
    for f in rows:
        seconds = (f.first_paint, f.loaded, f.busy, f.drawn)
        told = ("" if value is None else f"{value:.2f}" for value in seconds)
        table.add_row(f.name, f"{f.bytes / 1e6:.2f}", str(f.requests), str(f.statements), *told)
    Console().print(table)
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return 0


if __name__ == "__main__":
    sys.exit(main())
