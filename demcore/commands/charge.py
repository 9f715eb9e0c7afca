"""python -m demcore charge coke | iron: the plant drawn, the cost told, the charge run, the burden measured."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from demcore.commands.arguments import output_folder
from demcore.commands.kept_run import add_run_options, run_kept, run_options
from demcore.commands.quantity import parse_quantity
from demcore.dormancy import Dormancy
from demcore.experiments.charge_case import ChargeTest, charge_names, load_charge
from demcore.plant.plant_file import load_plant

if TYPE_CHECKING:
    from demcore.experiments.charge_result import ChargeResult


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    run = commands.add_parser("charge", help="one charge of the hopper by belt and deflector")
    run.add_argument("charge", help=", ".join(charge_names()))
    run.add_argument(
        "--plant", type=Path, metavar="FILE", help="what differs from the shipped plant, as TOML"
    )
    run.add_argument("--scale", type=float, default=4.0, help="coarse-graining factor (default 4)")
    run.add_argument("--seed", type=int, default=1)
    run.add_argument("--feed", help="feed only so long, at the charge's rate: enough to see belt and jet")
    run.add_argument("--rest", default="10s", help="simulated time after the last grain came (default 10s)")
    run.add_argument("--draw", action="store_true", help="only draw the plant from three sides")
    run.add_argument("--estimate", action="store_true", help="only tell what the charge would cost")
    run.add_argument("--no-dormancy", action="store_true", help="compute particles that do nothing, too")
    add_run_options(run, "charge", "1s")
    run.set_defaults(run=charge)


def charge(arguments: argparse.Namespace) -> int:
    """Check, draw, tell the cost, run, measure. Everything is checked before a folder is made."""
    ordered = load_charge(arguments.charge)
    if arguments.feed is not None:
        ordered = replace(ordered, duration=parse_quantity("feed", arguments.feed, "time"))
    test = ChargeTest(
        ordered,
        load_plant(arguments.plant),
        scale=arguments.scale,
        seed=arguments.seed,
        rest_seconds=parse_quantity("rest", arguments.rest, "time"),
        dormancy=None if arguments.no_dormancy else Dormancy(),
    )
    options = run_options(arguments)
    from demcore.experiments.charge_test import estimate_cost, run_charge
    from demcore.experiments.plant_drawing import draw_plant

    if arguments.estimate:
        print(estimate_cost(test).sentence())
        return 0
    with output_folder(arguments.out) as folder:
        draw_plant(test.plant, folder / "plant.png")
        if arguments.draw:
            print(f"plant drawn: {folder / 'plant.png'}")
            return 0
        print(_coarseness(test) + estimate_cost(test).sentence(), flush=True)
        result = run_kept(test, run_charge, options, folder, write_files)
    _tell(result, folder)
    return 0


def _coarseness(test: ChargeTest) -> str:
    if not test.merged_share:
        return ""
    return (
        f"scale {test.scale:g}: {test.merged_share:.0%} of the mass would be grains above "
        f"{test.largest_diameter:.3f} m, {test.largest_share:.0%} of the narrowest passage, and is simulated "
        "below it\n"
    )


def write_files(result: ChargeResult, folder: Path) -> None:
    """Result, pictures and summary; the summary last, so that where it lies a charge is whole."""
    from demcore.experiments.charge_drawing import draw_all
    from demcore.experiments.charge_file import write_charge
    from demcore.output.result_file import without_nan

    write_charge(result, folder / "charge.vtkhdf")
    draw_all(result, folder)
    text = json.dumps(without_nan(result.summary() | {"findings": result.findings()}), indent=1) + "\n"
    (folder / "summary.json").write_text(text, encoding="utf-8")


def _tell(result: ChargeResult, folder: Path) -> None:
    summary, seat = result.summary(), -result.test.plant.hopper.seat_depth
    for line in mass_lines(summary):
        print(line)
    for k, pile in enumerate(result.piles):
        print(
            f"pile {k + 1} at {pile.azimuth_deg:.0f} deg, {pile.radius:.2f} m from the axis: "
            f"{pile.height - seat:.2f} m above the seat, {pile.volume:.2f} m3, mean size {1e3 * pile.size:.0f} mm"
        )
    for valley in result.depressions:
        print(f"depression at {valley.azimuth_deg:.0f} deg, {valley.depth:.2f} m deep: {valley.cause}")
    rate = summary["particle_steps"] / max(summary["wall_s"], 1e-9)
    print(
        f"simulated {summary['simulated_s']:.1f} s in {summary['wall_s']:.0f} s, {rate:.2e} particle-steps/s\n"
        f"files in {folder}: charge.vtkhdf, summary.json, plant.png, burden.png, charge.png, curves.png, wear.png"
    )


def mass_lines(summary: dict[str, Any]) -> list[str]:
    """Where the mass is, what the belt carried, how even the burden lies."""
    s, belt = summary, summary["belt"]
    return [
        f"mass in {s['fed_kg']:.2f} kg = belt {s['on_belt_kg']:.2f} + flight {s['in_flight_kg']:.2f} + hopper "
        f"{s['in_hopper_kg']:.2f} + lost {s['lost_kg']:.2f} kg ({s['missing_kg']:.1e} missing); "
        f"{s['squeezed_through_walls']} grains were squeezed through walls",
        f"belt {belt['rate_kg_s']:.2f} kg/s of {belt['set_rate_kg_s']:.2f}; height and size on it correlate by "
        f"{belt['stratification']:+.2f}; {s['jet']['far_of_ridge']:.0%} of the jet passes beyond the ridge",
        f"by sector: mass varies by {s['variation_of_mass']:.0%}, height {s['variation_of_height']:.0%}, size "
        f"{s['variation_of_size']:.0%}; {s['far_share_of_mass']:.0%} lies on the far side; segregation "
        f"{s['segregation_intensity']:.3f} ({s['segregation_of_a_random_mix']:.3f} by chance)",
    ]
