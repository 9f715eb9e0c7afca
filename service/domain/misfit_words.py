"""Plain words for where a simulation misses what was measured: readings of a test, and the places of an answer."""

from __future__ import annotations

from collections.abc import Mapping

# By the names of worker/diagnosis/summaries.py, which a test compares with these.
READINGS: Mapping[str, str] = {
    "angle": "repose angle",
    "offset_x": "heap's offset, x",
    "offset_y": "heap's offset, y",
    "ln_apex": "apex height",
    "ln_mass": "mass on the base",
    "ln_t90": "discharge time, 90 %",
    "ln_density": "bulk density",
    "ln_d50": "median grain",
    "slope": "slope of the flank",
    "toe": "radius of the toe",
    "curvature": "curvature",
    "dipole_c": "tilt, along x",
    "dipole_s": "tilt, along y",
    "h_mean": "mean height",
    "h_c1": "height, once around (x)",
    "h_s1": "height, once around (y)",
    "h_c2": "height, twice around (x)",
    "h_s2": "height, twice around (y)",
    "void_depth": "depth of the void",
    "far_height": "far pile's height",
    "near_height": "near pile's height",
    "ln_m_mean": "mean mass of a sector",
    "m_c1": "mass, once around (x)",
    "m_s1": "mass, once around (y)",
    "m_c2": "mass, twice around (x)",
    "m_s2": "mass, twice around (y)",
    "ln_d50_far": "median grain, far pile",
    "ln_d50_near": "median grain, near pile",
    "ln_belt_depth": "depth on the belt",
    "ln_t25": "discharge time, 25 %",
    "ln_t50": "discharge time, 50 %",
    "ln_t100": "discharge time",
}
KINDS: Mapping[str, str] = {
    "condition": "condition {}",
    "test": "all {} tests",
    "material": "all tests of {}",
    "wet": "the wet conditions",
}


# What is changed of the simulation's own settings, which should change nothing (effects.toml).
SELF_TESTS: Mapping[str, str] = {
    "self_time_step": "half the time step",
    "self_stiffness": "stiffer grains",
    "self_coarse_graining": "finer grains",
    "self_particle_number": "fewer grains",
}


def reading(name: str) -> str:
    """Of a summary."""
    return READINGS.get(name, name)


def place(block: str) -> str:
    """Of a block of the answer, such as `summary:pile.toe` or `condition:wet`."""
    kind, _, name = block.partition(":")
    if kind == "summary":
        test, _, summary = name.partition(".")
        return f"{reading(summary)} of the {test} tests"
    return KINDS[kind].format(name) if kind in KINDS else block
