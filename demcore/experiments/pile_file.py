"""The result file of a pile test: what was asked, what was measured, and every particle of the pile."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_result import PileResult
from demcore.output.result_file import Column, without_nan, write_result

KIND = "pile"
# The clock's, and so no part of an outcome.
OF_THE_CLOCK = ("wall_s",)


def describe_test(test: PileTest) -> dict[str, Any]:
    """Every input of a test, JSON-able: two tests with the same description are the same test."""
    described = without_nan(dataclasses.asdict(test))
    assert isinstance(described, dict)
    return described


def write_pile(result: PileResult, path: Path) -> None:
    """Write the result file; the same test gives the same bytes."""
    summary = {name: value for name, value in result.summary().items() if name not in OF_THE_CLOCK}
    columns = {
        "particles/position": Column(result.positions, "m", "centres on the base, z = 0"),
        "particles/radius": Column(result.radii, "m", "radii"),
        "particles/velocity": Column(result.velocities, "m/s", "velocities at the end"),
        "particles/material": Column(result.material_rows, "1", "row of the material table; 0 is the walls'"),
        "profile/radius": Column(result.r_m, "m", "distance from the axis"),
        "profile/height": Column(result.h_m, "m", "height of the surface, mean over the angle"),
        "profile/low": Column(result.h_low_m, "m", "lower edge of the band of heights"),
        "profile/high": Column(result.h_high_m, "m", "upper edge of the band of heights"),
        "angle/scan": Column(result.scan.sectors, "deg", "repose angle by the surface scan, per sector"),
        "angle/literal": Column(result.literal.sectors, "deg", "by the paper's four steps, per sector"),
    }
    write_result(path, KIND, result.test.seed, describe_test(result.test), summary, columns)
