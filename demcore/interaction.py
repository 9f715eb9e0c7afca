"""How materials touch: stiffness per material, coefficients per pair, for any number of grains and surfaces.

Rows of the tables: the surfaces that walls are made of first, then the grains, one row for each restitution
that a grain has at walls (the paper mixes two by mass share). Importable without numba.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from demcore.allowed import within
from demcore.errors import InputError
from demcore.material import Material, WallRestitution


@dataclass(frozen=True)
class Interaction:
    """How two materials touch: restitution in [0.05, 1], frictions, rolling resistance."""

    restitution: float
    static_friction: float
    dynamic_friction: float
    rolling_resistance: float

    def __post_init__(self) -> None:
        within("restitution", self.restitution, 0.05, 1.0)
        within("static_friction", self.static_friction, 0.0, 10.0)
        within("dynamic_friction", self.dynamic_friction, 0.0, self.static_friction)
        within("rolling_resistance", self.rolling_resistance, 0.0, 10.0)


@dataclass(frozen=True)
class Stiffness:
    """Young's modulus, Pa, and Poisson ratio of a material."""

    youngs_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        within("youngs_modulus", self.youngs_modulus, 1e3, 1e15, "Pa")
        within("poisson_ratio", self.poisson_ratio, 0.0, 0.5)


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


@dataclass(frozen=True)
class Surface:
    """What walls are made of; a wall's `material` is the place of its surface in the case's list."""

    name: str = "steel"
    stiffness: Stiffness = Stiffness(1e7, 0.25)


@dataclass(frozen=True)
class GrainContact:
    """How the grains `first` and `second` touch; twice the same name: one material with itself."""

    first: str
    second: str
    interaction: Interaction


@dataclass(frozen=True)
class WallContact:
    """How a grain touches a surface. `restitution` None: the mix by mass share that its material names."""

    grain: str
    surface: str
    static_friction: float
    dynamic_friction: float
    rolling_resistance: float
    restitution: float | None = None

    def __post_init__(self) -> None:
        self.interaction(1.0 if self.restitution is None else self.restitution)

    def interaction(self, restitution: float) -> Interaction:
        """The contact of grains that rebound with `restitution`, unless the contact has its own."""
        e = restitution if self.restitution is None else self.restitution
        return Interaction(e, self.static_friction, self.dynamic_friction, self.rolling_resistance)


# What two unlike grains do when nothing is given for the pair.
UNLIKE_RULES = ("mean", "given")


class GrainRow(NamedTuple):
    """A row of the tables that particles may have: which grain, what it does at walls, its share of that mass."""

    row: int
    grain: str
    wall: WallRestitution


@dataclass(frozen=True)
class Interactions:
    """Every contact of a case. `unlike` says what unlike grains without an entry do: `mean` takes the mean of
    each coefficient over the two materials (physics.md section 1 names it for rolling), `given` refuses."""

    grain_contacts: tuple[GrainContact, ...]
    wall_contacts: tuple[WallContact, ...] = ()
    surfaces: tuple[Surface, ...] = (Surface(),)
    unlike: str = "mean"

    def __post_init__(self) -> None:
        if self.unlike not in UNLIKE_RULES:
            raise InputError("interactions.unlike", self.unlike, " or ".join(UNLIKE_RULES))
        named: tuple[tuple[str, list[Any]], ...] = (
            ("interactions.surfaces", [s.name for s in self.surfaces]),
            (
                "interactions.grain_contacts",
                [tuple(sorted((c.first, c.second))) for c in self.grain_contacts],
            ),
            ("interactions.wall_contacts", [(c.grain, c.surface) for c in self.wall_contacts]),
        )
        for field, keys in named:
            for key in keys:
                if keys.count(key) > 1:
                    raise InputError(field, key, "each once")

    def between(self, first: str, second: str) -> Interaction:
        """The contact of two grains. Raises InputError where nothing says it."""
        for contact in self.grain_contacts:
            if {contact.first, contact.second} == {first, second}:
                return contact.interaction
        if first == second or self.unlike == "given":
            raise InputError(
                "interactions.grain_contacts", (first, second), "an entry for this pair of materials"
            )
        return mean_interaction(self.between(first, first), self.between(second, second))

    def at_wall(self, grain: str, surface: str) -> WallContact:
        """The contact of a grain with a surface. Raises InputError where nothing says it."""
        for contact in self.wall_contacts:
            if (contact.grain, contact.surface) == (grain, surface):
                return contact
        raise InputError(
            "interactions.wall_contacts", (grain, surface), "an entry for this material and surface"
        )

    def assumed_pairs(self, grains: Sequence[Material]) -> list[str]:
        """Pairs of unlike grains whose coefficients are means, for the record of a run."""
        given = {frozenset((c.first, c.second)) for c in self.grain_contacts}
        names = [g.name for g in grains]
        pairs = [(a, b) for k, a in enumerate(names) for b in names[k + 1 :]]
        return [f"{a} and {b}" for a, b in pairs if frozenset((a, b)) not in given]


def mean_interaction(a: Interaction, b: Interaction) -> Interaction:
    """Each coefficient is the mean of the two (physics.md section 1, choice for rolling; ours for the others)."""
    return Interaction(
        0.5 * (a.restitution + b.restitution),
        0.5 * (a.static_friction + b.static_friction),
        0.5 * (a.dynamic_friction + b.dynamic_friction),
        0.5 * (a.rolling_resistance + b.rolling_resistance),
    )


def grain_rows(grains: Sequence[Material], surfaces: int) -> tuple[GrainRow, ...]:
    """The rows after the `surfaces` first ones: one for each grain and each restitution it has at walls."""
    pairs = [(g.name, mix) for g in grains for mix in g.wall_restitution]
    return tuple(GrainRow(surfaces + k, name, mix) for k, (name, mix) in enumerate(pairs))


def compose_table(
    grains: Sequence[Material], interactions: Interactions, touched: Collection[str]
) -> MaterialTable:
    """The full table of a case. Raises InputError for a pair that nothing says and no rule covers; of surfaces
    only those `touched`, the ones that a wall is made of, need saying."""
    surfaces = interactions.surfaces
    rows = grain_rows(grains, len(surfaces))
    of = {g.name: Stiffness(g.youngs_modulus, g.poisson_ratio) for g in grains}
    stiffness = tuple(s.stiffness for s in surfaces) + tuple(of[row.grain] for row in rows)
    # Walls do not touch walls, and nothing touches a surface that no wall has: never read.
    apart = Interaction(1.0, 0.0, 0.0, 0.0)
    table = [[apart] * len(stiffness) for _ in stiffness]
    for row in rows:
        for k, surface in enumerate(surfaces):
            if surface.name not in touched:
                continue
            contact = interactions.at_wall(row.grain, surface.name).interaction(row.wall.value)
            table[row.row][k] = table[k][row.row] = contact
        for other in rows:
            table[row.row][other.row] = interactions.between(row.grain, other.grain)
    return MaterialTable(stiffness, tuple(tuple(line) for line in table))
