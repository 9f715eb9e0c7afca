"""python -m demcore pile MATERIAL: one pile test, its numbers, its files."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from demcore.commands.arguments import check_at_least, output_folder
from demcore.commands.kept_run import add_run_options, run_kept, run_options
from demcore.commands.quantity import parse_quantity
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.experiments.contact_parameters import LIMITS, MIXING_RULES, ContactParameters, Parameters
from demcore.experiments.mix_trials import pairwise_optimum
from demcore.experiments.paper_tables import TABLE_5
from demcore.experiments.pile_case import PileTest
from demcore.material import Material, load_material, material_names
from demcore.material_file import read_material
from demcore.rig import FEWEST_DIAMETERS, load_rig, rig_names
from demcore.time_step import PRESETS

if TYPE_CHECKING:
    from demcore.experiments.pile_result import PileResult

# The paper's four by their options; what else a contact has, by its own name.
FOUR = ("friction", "wall_friction", "restitution", "rolling")
FURTHER = tuple(LIMITS)[len(FOUR) :]


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Its arguments."""
    run = commands.add_parser("pile", help="one pile test")
    run.add_argument("material", help=", ".join(material_names()) + ", or one of --material-file")
    run.add_argument("--material-file", type=Path, metavar="FILE", help="materials as TOML, one table each")
    run.add_argument("--rig", help="whose rig of Table 2 (default: the material's own)")
    run.add_argument("--scale", type=float, default=2.0, help="coarse-graining factor (default 2)")
    run.add_argument("--seed", type=int, default=1)
    run.add_argument("--fill-level", type=float, default=1.0, help="share of the cylinder's height")
    run.add_argument("--friction", type=float, help="between particles (default: the paper's Table 5)")
    run.add_argument("--wall-friction", type=float)
    run.add_argument("--restitution", type=float)
    run.add_argument("--rolling", type=float)
    run.add_argument(
        "--parameter",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="another parameter of the contacts, as dynamic_friction_ratio=.8 (repeatable): "
        + ", ".join(FURTHER),
    )
    run.add_argument(
        "--pairs",
        choices=tuple(MIXING_RULES),
        help="a mix: every part by its own Table 5, unlike parts by this rule (default: one set for all contacts)",
    )
    run.add_argument("--contact-model", default="paper", help="paper or hertz_mindlin")
    run.add_argument("--time-step", default="fast", help="fast, paper, or a time with its unit, as 20us")
    run.add_argument(
        "--lift", metavar="SPEED", help="lift the cylinder, as 30mm/s (default: it vanishes at once)"
    )
    run.add_argument(
        "--dormancy",
        action="store_true",
        help="hold particles that do nothing, and compute them again when something happens to them",
    )
    add_run_options(run, "pile", "50ms")
    run.set_defaults(run=pile)


def pile(arguments: argparse.Namespace) -> int:
    """Run one pile test, show progress, write its files. Everything is checked before a folder is made."""
    test = pile_test(arguments)
    options = run_options(arguments)
    from demcore.experiments.pile_test import run_pile_test

    with output_folder(arguments.out) as folder:
        result = run_kept(test, run_pile_test, options, folder, _write)
    series = "" if options.frame_interval is None else "; over time: spheres.vtkhdf, walls.vtkhdf"
    _tell(result, folder, series)
    return 0


def pile_test(arguments: argparse.Namespace) -> PileTest:
    """The test that the arguments ask for. Raises InputError."""
    material = chosen_material(arguments)
    rig = arguments.rig or arguments.material
    if rig not in rig_names():
        raise InputError("rig", rig, "one of " + ", ".join(rig_names()) + ", by --rig")
    preset = arguments.time_step in PRESETS
    test = PileTest(
        material,
        load_rig(rig),
        chosen_parameters(arguments, material),
        scale=arguments.scale,
        seed=arguments.seed,
        fill_level=arguments.fill_level,
        contact_model=arguments.contact_model,
        time_step=arguments.time_step if preset else "fast",
        lift_speed=None if arguments.lift is None else parse_quantity("lift", arguments.lift, "speed"),
        dormancy=Dormancy() if arguments.dormancy else None,
    )
    check_at_least("seed", test.seed, 0)
    return test if preset else with_time_step(test, arguments.time_step)


def chosen_material(arguments: argparse.Namespace) -> Material:
    """From the given file, else the shipped one."""
    if arguments.material_file is not None:
        return read_material(arguments.material_file, arguments.material)
    return load_material(arguments.material)


def chosen_parameters(arguments: argparse.Namespace, material: Material) -> Parameters:
    """One set for all contacts, or with --pairs the paper's optimum of each part of a mix."""
    if arguments.pairs is None:
        return contact_parameters(arguments)
    given = [name for name in FOUR if getattr(arguments, name) is not None]
    if given or arguments.parameter:
        raise InputError(
            "pairs", arguments.pairs, f"without --{(given or ['parameter'])[0]}: parts have their own"
        )
    return pairwise_optimum(material, arguments.pairs)


def contact_parameters(arguments: argparse.Namespace) -> ContactParameters:
    """What was given; for the rest the paper's optimum, which a material of one's own has none of."""
    known = TABLE_5.get(arguments.material, (None,) * 4)
    values: list[float] = []
    for name, usual in zip(FOUR, known, strict=True):
        value = getattr(arguments, name)
        chosen = usual if value is None else value
        if chosen is None:
            raise InputError(name, None, f"a value: only {', '.join(TABLE_5)} stand in the paper's Table 5")
        values.append(chosen)
    return ContactParameters(*values, **further_parameters(arguments.parameter))


def further_parameters(texts: list[str]) -> dict[str, float]:
    """NAME=VALUE by name. Raises InputError for another name, one given twice, or what is no number."""
    found: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if name not in FURTHER or name in found:
            raise InputError("parameter", text, "NAME=VALUE, once each for " + ", ".join(FURTHER))
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError("parameter", text, f"{name} with a number, as {name}=.5") from None
    return found


def with_time_step(test: PileTest, text: str) -> PileTest:
    """The test with a time step in seconds. Raises InputError above the largest one that is stable."""
    if not any(character.isdigit() for character in text):
        raise InputError("time_step", text, " or ".join(PRESETS) + ", or a time with its unit, as 20us")
    seconds = parse_quantity("time_step", text, "time")
    limit = test.dt
    if seconds > limit:
        raise InputError("time_step", text, f"at most {limit * 1e6:.3f}us, the limit of the loading time")
    return replace(test, time_step_factor=seconds / limit)


def _write(result: PileResult, folder: Path) -> None:
    from demcore.experiments.pile_file import write_pile
    from demcore.picture import draw_pile

    write_pile(result, folder / "result.h5")
    result.write(folder / "pile.vtkhdf")
    draw_pile(result.positions, result.radii, result.test.rig.base_radius, folder / "pile.png")
    text = json.dumps(result.summary(), indent=1) + "\n"
    (folder / "summary.json").write_text(text, encoding="utf-8")


def _tell(result: PileResult, folder: Path, series: str) -> None:
    summary, test = result.summary(), result.test
    rate = summary["particle_steps"] / max(summary["wall_s"], 1e-9)
    is_coarse = test.diameters_across_base < FEWEST_DIAMETERS
    coarse = (
        f" (under {FEWEST_DIAMETERS:g} the angle feels the grains' size: a finer scale)" if is_coarse else ""
    )
    print(
        f"repose angle {result.angle_deg:.2f} +- {result.angle_sd_deg:.2f} deg (surface scan, standard error of "
        f"{len(result.scan.sectors)} sectors); the paper's literal reading {result.literal_angle_deg:.2f} deg\n"
        f"mass on the base {summary['mass_on_base_kg']:.2f} kg of {summary['mass_filled_kg']:.2f} kg, "
        f"{summary['particles_on_base']} of {summary['particles_filled']} particles\n"
        f"simulated {summary['simulated_s']:.2f} s in {summary['wall_s']:.1f} s, {rate:.2e} particle-steps/s, "
        f"scale {test.scale:g}, {test.diameters_across_base:.1f} mean diameters along the base's radius{coarse}\n"
        f"files in {folder}: result.h5, pile.vtkhdf, pile.png, summary.json{series}"
    )
