"""Renews docs/pictures: every page at a laptop's and a phone's size. `make pictures [DATA="dir ..."] [URL=...]`

From real runs: of data folders (which are copied, never written to), of a service that runs, or, where neither
is named, of a small installation that is made for it, as coarse as it may be (tests/browser/picture_runs.py, a
quarter of an hour of a core); its data are thrown away, unless `--keep FOLDER` says where they stay. A page is
taken from the first place that has it.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
from PIL import Image

from service.db.migrate import upgrade
from service.db.presence import report_presence
from service.db.session import Database
from service.domain.diagnosis import PLAN
from service.settings import Settings
from tests.browser.chromium import LAPTOP, PHONE, missing, running_chromium, wait_until
from tests.browser.picture_runs import asking_installation, small_installation
from tests.builders.server import Server

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
MOST_BYTES = 300_000
# Up to this size without loss, beyond it with a palette.
LOSSLESS_BYTES = 200_000
COLOURS = 256
# Charts and 3D views are drawn, or say that they have nothing to draw; a cost has been told.
SETTLED = """[...document.querySelectorAll("[data-chart]")].every(
  (box) => box.querySelector(".main-svg, .chart-state") && !box.textContent.includes("Drawing"))
  && [...document.querySelectorAll("[data-scene]")].every((box) => box.dataset.drawn !== undefined
    || !box.querySelector('[data-part="state"]').textContent.includes("oading"))
  && document.getElementById("cost")?.textContent !== "…" """
DARK = ("study", "charge", "diagnosis", "health")
# Nothing is hidden in the second: its verdict shows what a diagnosis says then.
CASES = ("case_00", "case_05")


@dataclass(frozen=True)
class Shot:
    """A page by the name of its picture; or a picture that the service stores, kept as it is."""

    name: str
    path: str
    is_file: bool = False


def shots_of(url: str) -> list[Shot]:
    """The pages that a service has something to show on."""
    found = [Shot("overview", "/"), Shot("health", "/health")]
    found += [Shot(f"new_{key}", f"/new/{key}") for key in ("study", "charge", "diagnosis", "measurement")]
    found += [*_study_shots(url), *_charge_shots(url), *_diagnosis_shots(url)]
    geometries = [item["id"] for item in _items(url, "/v1/geometries")]
    if geometries:
        found += [Shot("geometries", "/geometries"), Shot("geometry", f"/geometries/{geometries[0]}")]
    return found


def _study_shots(url: str) -> list[Shot]:
    """Of the study that shows most: recommended, certified; piles are of one that still has its files."""
    studies = _items(url, "/v1/studies?limit=50")
    studies.sort(key=lambda item: not (item["recommendation"] or {}).get("certified"))
    over = [item for item in studies if item["recommendation"]] or studies
    if not over:
        return []
    first = over[0]
    found = [
        Shot("study", f"/studies/{first['id']}"),
        Shot("analysis", f"/studies/{_reported(url, over)}/analysis"),
        Shot("report_study", f"/studies/{first['id']}/report"),
    ]
    pair = next((designs for item in over if (designs := _piles(url, item["id"]))), None)
    if pair is not None:
        found.append(Shot("design", f"/designs/{pair[0]}"))
        found.append(Shot("compare_piles", f"/compare?kind=design&a={pair[0]}&b={pair[1]}"))
    alike = [item["id"] for item in over[1:] if item["material"] == first["material"]]
    if alike:
        found.append(Shot("compare_studies", f"/compare?kind=study&a={first['id']}&b={alike[0]}"))
    return found


def _charge_shots(url: str) -> list[Shot]:
    charges = _items(url, "/v1/charges")
    over = [item for item in charges if item["findings"]]
    found = [Shot("charges", "/charges")] if charges else []
    found += [Shot("charge_running", f"/charges/{c['id']}") for c in charges if c["state"] == "RUNNING"][:1]
    if over:
        found.append(Shot("charge", f"/charges/{over[0]['id']}"))
        others = [item["id"] for item in over[1:] if item["scale"] == over[0]["scale"]]
        if others:
            found.append(Shot("compare_charges", f"/compare?kind=charge&a={others[0]}&b={over[0]['id']}"))
    return found


def _diagnosis_shots(url: str) -> list[Shot]:
    over = [item for item in _items(url, "/v1/diagnoses") if item["result"] and item["verdict"] != PLAN]
    # First what names most: its card has all four panels, or at least suspects.
    over.sort(key=lambda item: (not item["result"].get("claims"), not item["result"].get("also_possible")))
    if not over:
        return []
    first = over[0]
    found = [
        Shot("diagnoses", "/diagnoses"),
        Shot("diagnosis", f"/diagnoses/{first['id']}"),
        Shot("report_diagnosis", f"/diagnoses/{first['id']}/report"),
    ]
    cards = [file["id"] for file in first["artifacts"] if file["kind"] == "card"]
    found += [Shot("diagnosis_card", f"/v1/artifacts/{card}", is_file=True) for card in cards]
    versions = [item["id"] for item in _items(url, "/v1/model-versions")]
    if len(versions) > 1:
        found.append(Shot("compare_models", f"/compare?kind=model&a={versions[1]}&b={versions[0]}"))
    return found


def ask(address: str) -> httpx.Response:
    """On two cores that simulate beside it a service takes its time."""
    return httpx.get(address, timeout=60.0)


def _items(url: str, path: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = ask(url + path).json()["items"]
    return found


def _reported(url: str, studies: Sequence[dict[str, Any]]) -> int:
    """The first with a report, from which most of an analysis is drawn; an imported study brings none."""
    ids = [int(item["id"]) for item in studies]
    return next((i for i in ids if ask(f"{url}/v1/studies/{i}/report").status_code == 200), ids[0])


def _piles(url: str, study: int) -> tuple[int, int] | None:
    """The first recommended design and another one, else the first two with an angle; None: no grains."""
    told = ask(f"{url}/v1/studies/{study}").json()["recommendation"] or {}
    items = _items(url, f"/v1/studies/{study}/designs?limit=200")
    seen = [item for item in items if item["angle_deg"] is not None]
    best = [item for item in seen if item["number"] in told.get("numbers", [])] or seen
    if not best or ask(f"{url}/designs/{best[0]['id']}/scene").json()["state"] != "ready":
        return None
    others = [item for item in seen if item["id"] != best[0]["id"]] or best
    return int(best[0]["id"]), int(others[-1]["id"])


def take(browser: Browser, address: str, name: str, size: tuple[int, int], scheme: str = "light") -> None:
    """One page as docs/pictures/NAME.png, once it has settled."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="reduce",
        locale="en-GB",
        timezone_id="UTC",
    )
    page = context.new_page()
    page.goto(address, wait_until="load", timeout=120_000)
    wait_until(page, SETTLED, 120.0)
    page.wait_for_timeout(1000)
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    context.close()
    shrink(path)
    print(f"{path.relative_to(PICTURES.parents[1])}  {path.stat().st_size // 1000} kB", flush=True)


def shrink(path: Path) -> None:
    """Without loss where that is small enough, else with a palette."""
    picture = Image.open(path).convert("RGB")
    picture.save(path, optimize=True)
    if path.stat().st_size > LOSSLESS_BYTES:
        picture.quantize(COLOURS, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{path} has {path.stat().st_size} bytes, allowed are {MOST_BYTES}")


@contextmanager
def serving_copy(folder: Path) -> Iterator[str]:
    """The URL of a service over a copy of a data folder: its database copied, its files only looked at."""
    if not (folder / "talus.db").is_file():
        raise SystemExit(f"{folder} has no talus.db: it is no data folder of Talus.")
    with tempfile.TemporaryDirectory(prefix="talus-pictures-") as name:
        copy = Path(name)
        source = sqlite3.connect(f"file:{folder / 'talus.db'}?mode=ro", uri=True)
        target = sqlite3.connect(copy / "talus.db")
        source.backup(target)
        source.close()
        target.close()
        for part in ("artifacts", "geometries", "checkpoints"):
            if (folder / part).is_dir():
                (copy / part).symlink_to((folder / part).resolve())
        settings = Settings(data_dir=copy, database_url=f"sqlite:///{copy / 'talus.db'}")
        upgrade(settings.resolved_database_url)
        database = Database(settings.resolved_database_url)
        server = Server(settings)
        server.start()
        over = threading.Event()
        reporting = threading.Thread(target=_be_present, args=(database, over))
        reporting.start()
        try:
            yield server.url
        finally:
            over.set()
            reporting.join()
            server.stop()
            database.dispose()


def _be_present(database: Database, over: threading.Event) -> None:
    """The pictures are of the pages of an installation that runs, and a copy has no processes."""
    while True:
        for role in ("worker", "dispatcher"):
            with database.writing() as session:
                report_presence(session, f"picture-{role}", role, "here", os.getpid())
        if over.wait(5.0):
            return


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", nargs="*", type=Path, default=[], help="data folders to look at")
    parser.add_argument("--keep", type=Path, help="where a small installation's data stay")
    parser.add_argument("--url", help="a service that runs")
    parser.add_argument("--only", nargs="*", help="names of pictures, default: all")
    parser.add_argument("--budget", type=int, default=8)
    parser.add_argument("--charge-scale", type=float, default=16.0)
    parser.add_argument(
        "--cases", nargs="*", default=list(CASES), help="data sets of tests/diagnosis/piles/bank"
    )
    options = parser.parse_args()
    reason = missing()
    if reason is not None:
        raise SystemExit(reason)
    PICTURES.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        urls = [options.url.rstrip("/")] if options.url else []
        urls += [stack.enter_context(serving_copy(folder)) for folder in options.data]
        if not urls:
            made = small_installation(
                options.keep, options.budget, options.charge_scale, tuple(options.cases)
            )
            urls = [stack.enter_context(made)]
        browser = stack.enter_context(running_chromium())
        take_all(browser, urls, options.only)
        if not options.only or "login" in options.only:
            take_page(browser, stack.enter_context(asking_installation()), Shot("login", "/login"))


def take_all(browser: Browser, urls: Sequence[str], only: Sequence[str] | None) -> None:
    """Each page once, from the first place that has it."""
    done = set[str]()
    for url in urls:
        for shot in shots_of(url):
            if shot.name not in done and (not only or shot.name in only):
                done.add(shot.name)
                take_page(browser, url, shot)


def take_page(browser: Browser, url: str, shot: Shot) -> None:
    """A page in two sizes, some in the dark too."""
    if shot.is_file:
        (PICTURES / f"{shot.name}.png").write_bytes(ask(url + shot.path).content)
        return
    take(browser, url + shot.path, shot.name, LAPTOP)
    take(browser, url + shot.path, f"{shot.name}_phone", PHONE)
    if shot.name in DARK:
        take(browser, url + shot.path, f"{shot.name}_dark", LAPTOP, "dark")


if __name__ == "__main__":
    main()
