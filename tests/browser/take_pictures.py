"""Renews docs/pictures from a service that runs: `python -m tests.browser.take_pictures [--url ...] [--study N]`.

Run it after `make demo` while `make serve` runs, so that the pictures show a real study; a finished charge is
shown too. `--only charges` leaves the pictures of studies as they are.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
from PIL import Image

from tests.browser.chromium import LAPTOP, PHONE, missing, running_chromium, wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
MOST_BYTES = 300_000
COLOURS = 256
SETTLED = """[...document.querySelectorAll("[data-chart]")].every(
  (box) => box.querySelector(".main-svg, .chart-state") && !box.textContent.includes("Drawing"))"""


def take(
    browser: Browser, address: str, name: str, size: tuple[int, int] = LAPTOP, scheme: str = "light"
) -> None:
    """One page as docs/pictures/NAME.png; it has settled when its charts are drawn and its picture is there."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="reduce",
    )
    page = context.new_page()
    page.goto(address, wait_until="load")
    wait_until(page, SETTLED)
    page.wait_for_timeout(800)
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    context.close()
    shrink(path)
    print(f"{path.relative_to(PICTURES.parents[1])}  {path.stat().st_size // 1000} kB")


def shrink(path: Path) -> None:
    """Without loss where that is small enough, else with a palette."""
    picture = Image.open(path).convert("RGB")
    picture.save(path, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{path} has {path.stat().st_size} bytes, allowed are {MOST_BYTES}")


def latest_study(url: str) -> int:
    """The newest study that is over, else the newest."""
    items = httpx.get(f"{url}/v1/studies").json()["items"]
    if not items:
        raise SystemExit("There is no study yet: run `make demo` first.")
    return int(next((item for item in items if item["ended_at"]), items[0])["id"])


def shown_design(url: str, study: int) -> int:
    """The recommended design, else the first one with an angle."""
    found = httpx.get(f"{url}/v1/studies/{study}").json()["recommendation"] or {}
    numbers = found.get("numbers", [])
    items = httpx.get(f"{url}/v1/studies/{study}/designs").json()["items"]
    rows = [row for row in items if row["angle_deg"] is not None]
    return int(next((row for row in rows if row["number"] in numbers), rows[0])["id"])


def latest_charge(url: str) -> int | None:
    """The newest charge with results; None: there is none."""
    items = httpx.get(f"{url}/v1/charges").json()["items"]
    return next((int(item["id"]) for item in items if item["findings"]), None)


def take_studies(browser: Browser, url: str, study: int) -> None:
    """The overview, a study's page in three ways, and one of its designs."""
    design = shown_design(url, study)
    take(browser, f"{url}/", "overview")
    take(browser, f"{url}/studies/{study}", "study")
    take(browser, f"{url}/studies/{study}", "study_dark", scheme="dark")
    take(browser, f"{url}/studies/{study}", "study_phone", PHONE)
    take(browser, f"{url}/designs/{design}", "design")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--url", default="http://127.0.0.1:8642")
    parser.add_argument("--study", type=int, help="default: the newest that is over")
    parser.add_argument("--only", choices=("studies", "charges"), help="default: both")
    options = parser.parse_args()
    reason = missing()
    if reason is not None:
        raise SystemExit(reason)
    url = options.url.rstrip("/")
    PICTURES.mkdir(parents=True, exist_ok=True)
    with running_chromium() as browser:
        if options.only != "charges":
            take_studies(browser, url, options.study or latest_study(url))
        charge = None if options.only == "studies" else latest_charge(url)
        if charge is not None:
            take(browser, f"{url}/charges/{charge}", "charge")


if __name__ == "__main__":
    main()
