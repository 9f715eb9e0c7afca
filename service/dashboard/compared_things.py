"""What stands beside each other of two studies, two piles, two charges, two versions of the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from sqlalchemy.orm import Session

from demcore.experiments.charge_comparison import group_of, number_of
from service.dashboard import formats, words
from service.dashboard.charge_page import ChargePage, read_charge_page, tell
from service.dashboard.comparison import Comparison, Side, Table, Value
from service.dashboard.design_page import DesignPage, read_design_page
from service.dashboard.study_page import StudyPage, read_study_page
from service.db.models import DiagnosisRow, ModelVersionRow, StudyRow
from service.domain.effects import library
from service.domain.noise import SECTOR_FACTOR
from service.domain.observables import ANGLE, OBSERVABLES
from service.domain.spec_record import primary_response
from service.errors import NotFound
from service.studies.read_noise import read_noise

T = TypeVar("T")

# A 90 % interval of a normal distribution is so many standard deviations wide to each side.
Z_90 = 1.645


def compare_studies(session: Session, a: int, b: int) -> Comparison:
    """Goal, result with its certificate, noise, parameters. Raises NotFound."""
    first, second = (_found(read_study_page(session, one), "study", one) for one in (a, b))
    goals = [primary_response(page.study.spec) for page in (first, second)]
    observable = goals[0]["observable"]
    refused = None
    if observable != goals[1]["observable"]:
        told = " and ".join(words.observable_name(goal["observable"]) for goal in goals)
        refused = f"They aim at different numbers ({told}): a difference would say nothing."
    elif first.study.spec["scale"] != second.study.spec["scale"]:
        scales = " and ".join(f"{page.study.spec['scale']:g}" for page in (first, second))
        refused = (
            f"Their grains are coarse-grained by {scales}: the angle depends on it, so studies of one scale only"
            " are compared."
        )
    notes = _notes_of_materials(first.study, second.study)
    table = Table(refused is None)
    unit = OBSERVABLES[observable].unit if observable in OBSERVABLES else ""
    shown = partial(_in_unit, unit=unit)
    table.add(
        _capital(words.observable_name(observable)),
        "by the model where there is a recommendation, else of the nearest simulation",
        [_result(page) for page in (first, second)],
        shown,
    )
    noises = [Value(page.noise[0].sd if page.noise else None) for page in (first, second)]
    table.add("Scatter between runs", "standard deviation of runs that differ by their seed", noises, shown)
    chances = [Value(page.headline.window_probability) for page in (first, second)]
    table.add("Sure to be in the window", "by the model", chances, formats.chance)
    used = [Value(float(page.used)) for page in (first, second)]
    table.add("Simulations used", "of the budget", used, _count)
    inside = [Value(page.study.feasible / page.used if page.used else None) for page in (first, second)]
    table.add("Inside the window", "share of the simulations", inside, formats.percent)
    names = dict.fromkeys((*first.parameters, *second.parameters))
    for name in names:
        values = [_parameter(page, name) for page in (first, second)]
        table.add(
            _capital(words.parameter_name(name)), words.parameter_meaning(name), values, formats.parameter
        )
    sides = [_study_side(page) for page in (first, second)]
    return Comparison(sides[0], sides[1], table.rows, refused, notes)


def compare_designs(session: Session, a: int, b: int) -> Comparison:
    """Two piles: what was read from them, what they were made with. Raises NotFound."""
    pages = [_found(read_design_page(session, one), "design", one) for one in (a, b)]
    first, second = pages
    refused = None
    if first.study.material != second.study.material:
        refused = (
            f"They were made in different rigs ({first.study.material} and {second.study.material}):"
            " a difference would be the rigs', too."
        )
    elif first.design.scale != second.design.scale:
        refused = (
            f"Their grains are coarse-grained by {first.design.scale:g} and {second.design.scale:g}: the angle"
            " depends on it."
        )
    notes = [
        "The noise is what runs scatter by when nothing but their seed differs, as their studies know it; of a"
        " coarse run, what the sectors of its pile let expect."
    ]
    table = Table(refused is None)
    noises = [_run_noise(session, page) for page in pages]
    for name, known in OBSERVABLES.items():
        values = [
            Value(known.read(page.design.results or {}), noise.get(name))
            for page, noise in zip(pages, noises, strict=True)
        ]
        table.add(
            _capital(words.observable_name(name)), known.meaning, values, partial(_in_unit, unit=known.unit)
        )
    used = [{**page.fixed, **page.design.x} for page in pages]
    for name in dict.fromkeys((*used[0], *used[1])):
        values = [Value(one.get(name)) for one in used]
        table.add(
            words.parameter_name(name), words.parameter_meaning(name), values, formats.parameter, is_set=True
        )
    sides = [_design_side(page) for page in pages]
    return Comparison(sides[0], sides[1], table.rows, refused, notes)


def compare_charges(session: Session, a: int, b: int) -> Comparison:
    """Where the burden lies, beside the scatter of each one's series. Raises NotFound."""
    pages = [_found(read_charge_page(session, one), "charge", one) for one in (a, b)]
    notes = []
    lonely = [str(page.charge.id) for page in pages if len(page.measured) < 2]
    if lonely:
        notes.append(
            f"Charge {' and '.join(lonely)} ran with one seed alone: how far another seed would move its"
            " numbers is not known. A series (--seeds 3) tells."
        )
    if pages[0].charge.scale != pages[1].charge.scale:
        notes.append("Their grains are of different scale: a part of each difference may be that.")
    without = [
        f"Charge {page.charge.id} has no results ({page.charge.state.value.lower()})."
        for page in pages
        if not page.results
    ]
    table = Table(not without)
    for name, word in words.CHARGE_NUMBERS.items():
        table.add(word.text, word.meaning, [_of_series(page, name) for page in pages], partial(tell, name))
    sides = [_charge_side(page) for page in pages]
    return Comparison(sides[0], sides[1], table.rows, " ".join(without) or None, notes)


def compare_versions(session: Session, a: int, b: int) -> Comparison:
    """The effects of two versions of the model, each with its amplitude. Raises NotFound."""
    rows = [_found(session.get(ModelVersionRow, one), "model version", one) for one in (a, b)]
    first, second = rows
    refused = None
    if first.base != second.base:
        refused = f"They extend different simulators ({first.base} and {second.base})."
    table = Table(refused is None)
    known = library()
    for name in dict.fromkeys((*first.effects, *second.effects)):
        unit = next((row.effects[name]["unit"] for row in rows if name in row.effects), "")
        meaning = known[name].what if name in known else ""
        shown = partial(_in_unit, unit="" if unit == "1" else unit)
        # An effect that a version does not name is not in its model: its amplitude is none, not unknown.
        values = [_amplitude(row.effects[name]) if name in row.effects else Value(0.0, 0.0) for row in rows]
        table.add(name.replace("_", " "), meaning, values, shown)
    notes = [
        "An effect that a version does not name acts with amplitude 0 in it. ± is half of the 90 % interval"
        f" over {Z_90:g}."
    ]
    sides = [_version_side(session, row) for row in rows]
    return Comparison(sides[0], sides[1], table.rows, refused, notes)


def _found(one: T | None, what: str, number: int) -> T:
    if one is None:
        raise NotFound(f"There is no {what} {number}.")
    return one


def _run_noise(session: Session, page: DesignPage) -> Mapping[str, float | None]:
    """By observable. A study knows it of its own scale; of a coarse run the sectors of the pile tell."""
    if page.design.scale == page.study.spec["scale"]:
        return {noise.observable: noise.sd for noise in read_noise(session, page.study)}
    error = page.design.angle_sd_deg
    return {} if error is None else {ANGLE: SECTOR_FACTOR * error}


def _in_unit(value: float, unit: str) -> str:
    return f"{value:.2f}°" if unit == "deg" else formats.quantity(value, "" if unit == "1" else unit)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def _count(value: float) -> str:
    return formats.count(round(value))


def _notes_of_materials(a: StudyRow, b: StudyRow) -> list[str]:
    if a.material == b.material:
        return []
    return [
        f"They are of different materials ({a.material} and {b.material}), each with a target of its own."
    ]


def _result(page: StudyPage) -> Value:
    """The recommendation by the model, or the nearest simulation with the noise of a run."""
    found = page.study.recommendation
    if found is not None and page.headline.is_posterior:
        return Value(found.get("mean_deg"), found.get("sd_deg"))
    return Value(page.headline.angle_deg, page.noise[0].sd if page.noise else None)


def _parameter(page: StudyPage, name: str) -> Value:
    """The recommended one; how far the responses leave it open, from the report."""
    posterior = (page.report or {})["posterior"]["parameters"] if page.report_says_enough else ()
    spread = next((p for p in posterior if p.get("name") == name), dict[str, Any]())
    width = None
    if {"lower_90", "upper_90"} <= set(spread):
        width = (spread["upper_90"] - spread["lower_90"]) / (2.0 * Z_90)
    return Value(page.headline.x.get(name), width)


def _study_side(page: StudyPage) -> Side:
    study, goal = page.study, primary_response(page.study.spec)
    lower, upper = goal["window"]
    aim = formats.in_unit_of(goal["target"], goal["observable"])
    model = study.spec.get("model") or {}
    facts = [
        ("Material", study.material),
        (
            "Target",
            f"{aim} ({formats.in_unit_of(lower, goal['observable'])} to"
            f" {formats.in_unit_of(upper, goal['observable'])})",
        ),
        ("Scale", f"{study.spec['scale']:g}"),
        ("Model version", str(model.get("name", "baseline"))),
        ("How it ended", page.headline.verdict.text),
    ]
    picture = page.picture
    told = f"Best pile of study {study.id}"
    shown = page.shown.design if page.shown is not None else None
    return Side(
        f"Study {study.id}",
        f"/studies/{study.id}",
        facts,
        None if picture is None else picture.id,
        told,
        None if shown is None else f"/designs/{shown.id}/scene",
        _outline(page.results),
    )


def _design_side(page: DesignPage) -> Side:
    design, study = page.design, page.study
    facts = [
        ("Study", f"{study.id}: {study.material}"),
        ("Scale", f"{design.scale:g}"),
        ("Seed", str((design.results or {}).get("seed", formats.NOTHING))),
        ("Why", words.look_up(words.ORIGINS, design.origin).text),
    ]
    picture = page.picture
    return Side(
        f"Simulation {design.number} of study {study.id}",
        f"/designs/{design.id}",
        facts,
        None if picture is None else picture.id,
        f"Pile of simulation {design.number}",
        f"/designs/{design.id}/scene",
        _outline(design.results or {}),
    )


def _charge_side(page: ChargePage) -> Side:
    charge = page.charge
    facts = [
        ("Charge", charge.charge),
        ("Scale", f"{charge.scale:g}"),
        ("Seeds of its series", ", ".join(str(line.charge.seed) for line in page.series)),
        ("Contact parameters", str(charge.spec["parameters_from"])),
        *page.assumed,
    ]
    picture = next((file for file, _ in page.pictures), None)
    return Side(
        f"Charge {charge.id}",
        f"/charges/{charge.id}",
        facts,
        None if picture is None else picture.id,
        f"The burden of charge {charge.id}",
        f"/charges/{charge.id}/scene",
    )


def _version_side(session: Session, row: ModelVersionRow) -> Side:
    diagnosis = session.get(DiagnosisRow, row.diagnosis_id)
    gain = ((diagnosis.results if diagnosis is not None else None) or {}).get("gain") or {}
    told = None
    if {"rmse_before", "rmse_after"} <= set(gain):
        told = f"misfit {gain['rmse_before']:.3g} before, {gain['rmse_after']:.3g} with the effects"
    facts = [
        ("Simulator", row.base),
        ("Found by", f"diagnosis {row.diagnosis_id}"),
        *([("On what was held out", told)] if told else []),
        ("State", "in use" if row.withdrawn_at is None else "withdrawn"),
    ]
    return Side(row.name, f"/diagnoses/{row.diagnosis_id}", facts)


def _outline(results: Mapping[str, Any]) -> tuple[Sequence[float], Sequence[float]] | None:
    profile = results.get("profile")
    return (profile["r_m"], profile["h_m"]) if profile and profile.get("r_m") else None


def _of_series(page: ChargePage, name: str) -> Value:
    """This charge's own number; the scatter of its series, where it has one."""
    value = number_of(page.results, name)
    scatter = group_of([number_of(line.charge.results or {}, name) for line in page.measured]).sd
    return Value(value if math.isfinite(value) else None, scatter if math.isfinite(scatter) else None)


def _amplitude(effect: Mapping[str, Any]) -> Value:
    lower, upper = effect["ci90"]
    return Value(float(effect["value"]), (upper - lower) / (2.0 * Z_90))
