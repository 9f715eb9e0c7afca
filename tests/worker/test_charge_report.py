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
from worker.charge_report import Source, command_of, fixed, write_report

SECTORS = 4


def a_summary(name: str = "coke", **changes: Any) -> dict[str, Any]:
    """As a finished charge leaves it, with four sectors."""
    per_sector = [1.0, 2.0, 3.0, 4.0]
    pile = {"azimuth_deg": 200.0, "radius": 1.2, "height": -0.9, "volume": 2.0, "mass": 1000.0, "size": 0.1}
    slope = {"angle_deg": 34.2, "error_deg": 1.1, "directions": 5}
    found = {
        "piles": 2,
        "near_height_m": 1.0,
        "far_height_m": 1.5,
        "near_size_m": 0.10,
        "far_size_m": 0.14,
        "near_mass_kg": 1000.0,
        "far_mass_kg": 2000.0,
        "depressions": ["behind the rod", "under the deflector"],
    }
    belt = {"rate_kg_s": 41.6, "set_rate_kg_s": 41.67, "kg_per_m": 23.0, "stratification": 0.6}
    layers = {"layer_height_m": [0.01, 0.03], "layer_share": [0.6, 0.4], "layer_size_m": [0.08, None]}
    parameters = {"particle_particle_static_friction": 0.5, "youngs_modulus_pa": None}
    material = {"name": name, "target_deg": 36.5, "window_deg": [35.0, 38.0]}
    charge = {"name": name, "rate": 41.67, "duration": 72.0, "parameters": parameters, "material": material}
    sources = {"belt.speed_m_s": "paper, section 3.1", "bell.slope_deg": "assumed: usual"}
    summary = {
        "findings": found,
        "inputs": {
            "charge": charge,
            "plant": {
                "hopper": {"seat_depth": 2.8},
                "deflector": {"ridge_across": -0.18},
                "sources": sources,
            },
            "replaced": {},
            "rest_seconds": 10.0,
            "numerics": {"may_squeeze": 0.01},
            "dormancy": {"wake_share": 0.1},
        },
        "sectors": dict.fromkeys(
            ("azimuth_deg", "mass", "particles", "height", "volume", "size"), per_sector
        ),
        "bell_layer": {"within_m": 0.3, "mass_kg": per_sector, "size_m": per_sector},
        "harmonics": {"mass_1": {"amplitude": 0.4, "azimuth_deg": 300.0}},
        "piles": [pile | {"prominence": 0.4, "slope": slope}],
        "depressions": [{"azimuth_deg": 90.0, "height": -2.0, "depth": 1.0, "cause": "behind the rod"}],
        "belt": belt | layers,
        "jet": {
            "level_m": [-0.1],
            "x_5_50_95_m": [[-0.3, 0.1, 0.5]],
            "at_ridge_x_5_50_95_m": [-0.2, -0.1, 0.0],
            "far_of_ridge": 0.6,
            "size_near_of_ridge_m": 0.1,
            "size_far_of_ridge_m": 0.14,
        },
        "walls": {"bell": {"energy_J": 1000.0, "strikes": 10.0, "load_N": 500.0}},
        "account": {
            "time": [0.0, 1.0],
            "fed": [0.0, 40.0],
            "on_belt": [0.0, 10.0],
            "in_flight": [0.0, 10.0],
            "in_hopper": [0.0, 19.5],
            "lost": [0.0, 0.25],
        },
        **dict.fromkeys(
            (
                "variation_of_mass",
                "variation_of_height",
                "variation_of_volume",
                "variation_of_size",
                "far_share_of_mass",
                "segregation_intensity",
                "segregation_of_a_random_mix",
                "merged_share_of_mass",
            ),
            0.3,
        ),
        **dict.fromkeys(("volume_m3", "bulk_density_kg_m3", "level_if_even_m", "largest_diameter_m"), 1.0),
        **dict.fromkeys(("fed_kg", "asked_kg", "on_belt_kg", "in_flight_kg", "in_hopper_kg", "lost_kg"), 9.0),
        **dict.fromkeys(("particles", "squeezed_through_walls", "steps"), 5),
        **dict.fromkeys(("steady_from_s", "time_step_s", "particle_steps", "wall_s"), 2.0),
    }
    return summary | changes


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
