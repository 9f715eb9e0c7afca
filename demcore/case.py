"""Case: everything one simulation needs, as plain data. Frozen; importable without numba.

Materials are rows: row 0 is the walls', rows 1 and up are the grains'.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from demcore.errors import InputError


@dataclass(frozen=True)
class Interaction:
    """How two materials touch: restitution in (0, 1], frictions, rolling resistance."""

    restitution: float
    static_friction: float
    dynamic_friction: float
    rolling_resistance: float

    def __post_init__(self) -> None:
        _range("restitution", self.restitution, 0.05, 1.0)
        _range("static_friction", self.static_friction, 0.0, 10.0)
        _range("dynamic_friction", self.dynamic_friction, 0.0, self.static_friction)
        _range("rolling_resistance", self.rolling_resistance, 0.0, 10.0)


def _range(field: str, value: float, lower: float, upper: float) -> None:
    if not (math.isfinite(value) and lower <= value <= upper):
        raise InputError(field, value, f"{lower:g} to {upper:g}")


@dataclass(frozen=True)
class Stiffness:
    """Young's modulus, Pa, and Poisson ratio of a material."""

    youngs_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        _range("youngs_modulus", self.youngs_modulus, 1e3, 1e15)
        _range("poisson_ratio", self.poisson_ratio, 0.0, 0.5)


@dataclass(frozen=True)
class MaterialTable:
    """`stiffness[k]` of material row k; `interaction[i][j]` for every pair of rows, symmetric."""

    stiffness: tuple[Stiffness, ...]
    interaction: tuple[tuple[Interaction, ...], ...]

    def __post_init__(self) -> None:
        n = len(self.stiffness)
        if len(self.interaction) != n or any(len(row) != n for row in self.interaction):
            raise InputError("interaction", len(self.interaction), f"a square table of {n} rows")
        for i in range(n):
            for j in range(i):
                if self.interaction[i][j] != self.interaction[j][i]:
                    raise InputError("interaction", (i, j), "the same values as its mirror image")

    def arrays(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(M,) Young's moduli and (M, M, 6) pair values, as `demcore.forces.Tables` lists them.

        Effective moduli: 1/E* = sum (1 - nu^2)/E; 1/G* = sum 2 (2 - nu)(1 + nu)/E (Chung and Ooi 2011).
        """
        youngs = np.array([s.youngs_modulus for s in self.stiffness])
        n = len(youngs)
        pair = np.empty((n, n, 6))
        for i, a in enumerate(self.stiffness):
            for j, b in enumerate(self.stiffness):
                contact = self.interaction[i][j]
                e_star = 1.0 / sum((1.0 - s.poisson_ratio**2) / s.youngs_modulus for s in (a, b))
                g_star = 1.0 / sum(
                    2.0 * (2.0 - s.poisson_ratio) * (1.0 + s.poisson_ratio) / s.youngs_modulus for s in (a, b)
                )
                pair[i, j] = (
                    contact.restitution,
                    contact.static_friction,
                    contact.dynamic_friction,
                    contact.rolling_resistance,
                    e_star,
                    g_star,
                )
        return youngs, pair


def uniform_table(stiffness: Stiffness, interaction: Interaction, rows: int = 2) -> MaterialTable:
    """The same material and interaction for walls and all grains."""
    return MaterialTable((stiffness,) * rows, ((interaction,) * rows,) * rows)
