"""The report of a charge: whole, self-contained, honest about what agrees, safe with what a user wrote."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from demcore.experiments.charge_findings import compare_findings
from service.domain.charge import ChargeSpec
from tests.builders.charges import a_summary
from worker.charge_report import Source, command_of, fixed, write_report


class Collector(HTMLParser):
    """Addresses that a page asks for, and its open tags."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]


def written(tmp_path: Path, summary: dict[str, Any], spec: ChargeSpec) -> str:
    for name in ("burden", "plant"):
        Image.new("RGB", (4, 4)).save(tmp_path / f"{name}.png")
    path = tmp_path / "report.html"
    write_report(summary, Source(7, spec), tmp_path, path)
    return path.read_text(encoding="utf-8")


def test_the_page_holds_its_pictures_and_asks_for_nothing(tmp_path: Path) -> None:
    page = written(tmp_path, a_summary(), ChargeSpec("coke"))
    collector = Collector()
    collector.feed(page)
    assert len(collector.addresses) == 2
    assert all(address.startswith("data:image/png;base64,") for address in collector.addresses)
    assert "script" not in collector.tags
    assert not re.search(r"https?://", page)


def test_it_says_what_was_asked_assumed_found_and_checked(tmp_path: Path) -> None:
    page = written(tmp_path, a_summary(), ChargeSpec("coke", seed=3, plant={"belt": {"speed_m_s": 1.8}}))
    for said in (
        "Charge of coke",
        "seed 3",
        "two, near and far",
        "far 1.50 m, near 1.00 m above the seat (+0.50 m)",
        "behind the rod",
        "34.2° ± 1.1 (5)",
        "41.60 kg/s of the set 41.67",
        "assumed: usual",
        "belt.speed_m_s",
        "2.5e-01 kg",
        "talus charge coke --scale 4 --seed 3 --plant",
    ):
        assert said in page, said


def test_a_charge_too_short_for_a_steady_belt_has_a_report_too(tmp_path: Path) -> None:
    """What could not be measured is null in the summary, and a dash on the page."""
    summary = a_summary(**dict.fromkeys(("variation_of_size", "segregation_intensity", "steady_from_s")))
    for name in ("rate_kg_s", "kg_per_m", "stratification"):
        summary["belt"][name] = None
    summary["belt"]["layer_share"] = [None, None]
    summary["jet"] |= dict.fromkeys(("far_of_ridge", "size_near_of_ridge_m", "size_far_of_ridge_m"))
    summary["jet"] |= {"at_ridge_x_5_50_95_m": [None] * 3, "x_5_50_95_m": [[None] * 3]}
    page = written(tmp_path, summary, ChargeSpec("coke"))
    assert 'Mean size varies by</td><td class="n">– %' in page


def test_what_a_user_wrote_is_escaped(tmp_path: Path) -> None:
    spec = ChargeSpec("coke", parameters_from="<script>alert(1)</script>")
    assert "<script>" not in written(tmp_path, a_summary(), spec)


@pytest.mark.parametrize(
    ("name", "far", "near", "agrees"),
    [
        ("coke", 1.5, 1.0, True),
        ("coke", 1.0, 1.5, False),
        ("iron", 1.5, 1.45, True),
        ("iron", 1.5, 1.0, False),
        ("iron", None, 1.0, None),
    ],
)
def test_heights_agree_as_the_plant_saw_them(name: str, far: Any, near: Any, agrees: Any) -> None:
    """Coke: the far pile is higher; iron: they differ by less than a tenth."""
    summary = a_summary(name)
    summary["findings"] |= {"far_height_m": far, "near_height_m": near}
    assert compare_findings(summary)[1].agrees is agrees


def test_one_pile_and_no_sizes_are_said_and_not_judged() -> None:
    summary = a_summary()
    summary["findings"] |= {"piles": 1, "near_height_m": None, "near_size_m": None, "depressions": []}
    found = compare_findings(summary)
    assert [f.agrees for f in found] == [False, None, False, None]
    assert "only one side has a pile" in found[1].here


def test_the_command_asks_for_the_same_charge() -> None:
    spec = ChargeSpec("iron", scale=6.0, seed=2, parameters={"all": {"rolling_resistance": 0.2}})
    assert command_of(spec) == (
        'talus charge iron --scale 6 --seed 2 --parameters \'{"all": {"rolling_resistance": 0.2}}\''
    )


def test_a_number_that_is_not_there_is_a_dash() -> None:
    assert [fixed(v) for v in (None, float("nan"), 1.234)] == ["–", "–", "1.23"]
