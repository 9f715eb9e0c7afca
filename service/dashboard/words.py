"""Plain words for what rows hold: states, origins, verdicts, failures and parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from service.domain.diagnosis import PLAN
from service.domain.observables import OBSERVABLES
from service.domain.search_space import PARAMETERS
from service.domain.strategy import STRATEGIES
from service.domain.verdict_words import ONE_LIKELY, is_one_likely
from service.domain.verdict_words import VERDICTS as VERDICTS_IN_WORDS


@dataclass(frozen=True)
class Word:
    """A short text, and the sentence that explains it."""

    text: str
    meaning: str


# Short names for columns; what the parameter is stands in the search space.
PARAMETER_NAMES: Mapping[str, str] = {
    "particle_particle_static_friction": "friction particle–particle",
    "particle_wall_static_friction": "friction particle–steel",
    "particle_particle_restitution": "restitution",
    "rolling_resistance": "rolling resistance",
}

# Short names of observables, for axes; what each is, and its unit, stands in service/domain/observables.py.
OBSERVABLE_NAMES: Mapping[str, str] = {
    "angle_deg": "repose angle",
    "literal_angle_deg": "literal angle",
    "mass_on_base_kg": "mass on the base",
    "discharge_t90_s": "discharge, 90 %",
    "heap_height_m": "height of the heap",
    "heap_top_m": "top of the heap",
    "share_on_base": "share on the base",
    "discharge_t50_s": "discharge, 50 %",
    "filled_bulk_density_kg_m3": "bulk density",
    "fill_height_m": "height of the fill",
}
UNITS: Mapping[str, str] = {"deg": "°", "1": "", "kg/m3": "kg/m³"}

STUDY_STATES: Mapping[str, Word] = {
    "running": Word("running", "Simulations are proposed and run."),
    "paused": Word("paused", "Nothing new is proposed or started until somebody resumes it."),
    "finishing": Word("finishing", "Nothing new is proposed; the last simulations end."),
    "cancelling": Word("stopping", "A user stopped the study; what is in flight ends."),
    "completed": Word("finished", "The study ended by its own rules."),
    "cancelled": Word("stopped", "A user stopped the study. What it measured stays."),
    "failed": Word("failed", "The study could not go on."),
}

DESIGN_STATES: Mapping[str, Word] = {
    "WAITING": Word("waiting", "Waits for a free worker."),
    "RUNNING": Word("simulating", "A worker simulates it now."),
    "COMPLETE": Word("done", "The simulation ended with a pile."),
    "FAILED": Word("error", "The simulation gave no repose angle."),
    "CANCELLED": Word("cancelled", "Stopped before its end; it counts for nothing."),
}

CHARGE_STATES: Mapping[str, Word] = {
    "WAITING": Word("waiting", "Waits for a free worker."),
    "RUNNING": Word("simulating", "A worker simulates it now."),
    "COMPLETE": Word("done", "The simulation ended with a burden in the hopper."),
    "FAILED": Word("error", "The simulation gave no burden to measure."),
    "CANCELLED": Word("cancelled", "A user stopped it before its end."),
}


@dataclass(frozen=True)
class NumberWord(Word):
    """What a number of a charge is; `is_share`: it is told in per cent."""

    is_share: bool = False


# In the order of the page; names are demcore's (experiments/charge_comparison.py).
CHARGE_NUMBERS: Mapping[str, NumberWord] = {
    "piles": NumberWord("Piles", "heaps that stand out, by sector, by 5 % of the mean thickness or more"),
    "far_height_m": NumberWord("Far pile", "highest pile away from the belt, above the bell's seat"),
    "near_height_m": NumberWord("Near pile", "highest pile on the belt's side, above the bell's seat"),
    "far_size_m": NumberWord("Grains in the far pile", "mean diameter by mass"),
    "near_size_m": NumberWord("Grains in the near pile", "mean diameter by mass"),
    "far_slope_deg": NumberWord("Slope of the far pile", "mean of the steepest quarter of its flanks"),
    "near_slope_deg": NumberWord("Slope of the near pile", "mean of the steepest quarter of its flanks"),
    "far_side_size_m": NumberWord("Grains on the far side", "mean diameter by mass, heap or not"),
    "near_side_size_m": NumberWord("Grains on the near side", "mean diameter by mass, heap or not"),
    "far_share_of_mass": NumberWord("Mass on the far side", "of the plane through axis and hatch", True),
    "far_of_ridge": NumberWord("Jet beyond the ridge", "share of the undisturbed jet, by mass", True),
    "variation_of_mass": NumberWord("Mass by sector varies by", "standard deviation over mean", True),
    "variation_of_height": NumberWord("Height by sector varies by", "standard deviation over mean", True),
    "variation_of_size": NumberWord("Size by sector varies by", "standard deviation over mean", True),
    "segregation_intensity": NumberWord("Segregation", "Danckwerts' intensity over the sectors, 0 to 1"),
    "stratification": NumberWord("Stratification on the belt", "correlation of a grain's height and size"),
}

VERDICTS: Mapping[str, Word] = {
    "feasible": Word("in window", "Feasible: the repose angle lies inside the accepted window."),
    "unfeasible": Word("outside", "Unfeasible: the repose angle lies outside the accepted window."),
    "error": Word("error", "The simulation gave no repose angle."),
}

DIAGNOSIS_STATES: Mapping[str, Word] = {
    "WAITING": Word("waiting", "Waits for a free worker."),
    "RUNNING": Word("simulating", "A worker simulates the piles that it asks for."),
    "COMPLETE": Word("done", "There is a verdict."),
    "FAILED": Word("error", "It could not be carried out."),
    "CANCELLED": Word("stopped", "A user stopped it. Its simulations stay for the next one."),
}
DIAGNOSIS_VERDICTS: Mapping[str, Word] = {
    "no_misfit": Word("no misfit", VERDICTS_IN_WORDS["no_misfit"]),
    "named": Word("named", VERDICTS_IN_WORDS["named"]),
    "named_with_remainder": Word("named, with remainder", VERDICTS_IN_WORDS["named_with_remainder"]),
    "ambiguous": Word("ambiguous", VERDICTS_IN_WORDS["ambiguous"]),
    "unexplained": Word("unexplained", VERDICTS_IN_WORDS["unexplained"]),
    PLAN: Word("plan", "What these tests could show, before they are made."),
    "refused": Word("refused", VERDICTS_IN_WORDS["refused"]),
}
DIAGNOSIS_TONES: Mapping[str, str] = {
    "no_misfit": "good",
    "named": "good",
    "named_with_remainder": "doubt",
    "ambiguous": "doubt",
    "unexplained": "doubt",
    PLAN: "good",
    "refused": "bad",
}

ORIGINS: Mapping[str, Word] = {
    "doe": Word("initial", "Design of experiments: spread over the search space to learn its shape."),
    "model": Word("model", "Proposed by the model where it expects the largest gain."),
    "replicate": Word("repeat", "The same parameters with another random seed, to measure the scatter."),
    "manual": Word("by hand", "Parameters that a user asked for."),
    "import": Word("known", "Known before the study; it was not simulated for it."),
    "warm": Word("earlier", "From an earlier study of the same test."),
    "coarse": Word("coarse", "A cheap simulation with larger particles, to learn the shape."),
}

PHASES: Mapping[str, str] = {
    "settle": "filling and settling",
    "discharge": "discharge over the rim",
    "run-up": "run-up of the belt",
    "charge": "charging",
    "rest": "coming to rest",
    "diagnose": "simulating and comparing",
}

JOB_KINDS: Mapping[str, str] = {
    "simulate": "pile test",
    "propose": "choosing the next parameters",
    "recommend": "choosing the optimum",
    "report": "writing the report",
    "charge": "charge of the hopper",
    "diagnose": "diagnosis of measured data",
}

FAILURES: Mapping[str, str] = {
    "lost": "the worker vanished at every attempt",
    "out_of_memory": "not enough memory",
    "blow_up": "the simulation became unstable",
    "never_settles": "the pile never came to rest",
    "no_result": "no pile to measure",
    "error": "the simulation stopped with an error",
}

# Why a study ended, as its headline says it.
STOPS: Mapping[str, Word] = {
    "certified": Word("Certified", "The repose angle is inside the window beyond reasonable doubt."),
    "budget": Word("Not certified", "The budget of simulations is spent."),
    "design_complete": Word("Not certified", "The design that was asked for has run."),
    "futile": Word("Not certified", "More simulations would not improve the result."),
    "target_unreachable": Word("Not certified", "No parameters in the search space reach the target."),
    "too_many_failures": Word("Not certified", "Too many simulations ended in error."),
    "user": Word("Not certified", "A user stopped the study."),
    "error": Word("Failed", "The study could not go on."),
    "exported_early": Word("Not certified", "It was exported before its end."),
}

# Why a study is paused.
PAUSES: Mapping[str, Word] = {
    "user": Word("Paused", "A user paused the study."),
    "too_many_failures": Word("Paused", "Too many simulations ended in error."),
}

# How far the responses fix a parameter: its posterior sd over the prior's (calibration.md, decision 8).
IDENTIFIED: Mapping[str, Word] = {
    "identified": Word("identified", "The measured responses fix it: under 35 % of its spread is left."),
    "weak": Word("weakly identified", "The measured responses narrow it: 35 to 80 % of its spread is left."),
    "not identified": Word(
        "not identified", "The measured responses say nothing of it: any value in its range does as well."
    ),
}
IDENTIFIED_TONES: Mapping[str, str] = {"identified": "good", "weak": "doubt", "not identified": "bad"}

UNKNOWN = "Not explained yet."


def parameter_name(name: str) -> str:
    return PARAMETER_NAMES.get(name, name.replace("_", " "))


def observable_name(name: str) -> str:
    """What a response is, without its unit."""
    return OBSERVABLES[name].meaning if name in OBSERVABLES else name.replace("_", " ")


def strategy_meaning(name: str) -> str:
    return STRATEGIES.get(name, name)


def parameter_meaning(name: str) -> str:
    known = PARAMETERS.get(name)
    return known.meaning if known else name


def diagnosis_verdict(verdict: str, results: Mapping[str, Any] | None) -> Word:
    """The word for a verdict; an ambiguous one that knows of one cause only has another sentence."""
    found = look_up(DIAGNOSIS_VERDICTS, verdict)
    return replace(found, meaning=ONE_LIKELY) if is_one_likely(verdict, results) else found


def look_up(words: Mapping[str, Word], key: object) -> Word:
    """The word for `key` (a state or its text); the key itself where there is none."""
    text = str(getattr(key, "value", key))
    return words.get(text) or Word(text.lower().replace("_", " "), UNKNOWN)
