"""Materials: what a grain is made of and how large it is. Importable without numba.

Notation: d diameter, m; w mass share of a size class. Inside a class mass is uniform in d, so the number
density falls as d^-3.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from demcore.allowed import positive, shares, within
from demcore.errors import InputError


@dataclass(frozen=True)
class SizeClass:
    """Diameters from `lower` to `upper` (m) hold the share `mass_share` of the mass."""

    lower: float
    upper: float
    mass_share: float

    def __post_init__(self) -> None:
        positive("sizes.lower", self.lower, "m")
        if not (math.isfinite(self.upper) and self.upper >= self.lower):
            raise InputError("sizes.upper", self.upper, f"at least the lower limit {self.lower:g} m")
        if not (math.isfinite(self.mass_share) and self.mass_share > 0.0):
            raise InputError("sizes.mass_share", self.mass_share, "more than 0 (leave an empty class out)")

    @property
    def number_mean_cube(self) -> float:
        """Mean of d^3 over particles, m^3: (b - a) / integral of d^-3, the density that is uniform in mass."""
        if self.upper == self.lower:
            return self.lower**3
        return (self.upper - self.lower) / (0.5 * (self.lower**-2 - self.upper**-2))


@dataclass(frozen=True)
class SizeDistribution:
    """Mass shares per size class; shares must sum to 1 within 1e-6 and classes must not overlap."""

    classes: tuple[SizeClass, ...]

    def __post_init__(self) -> None:
        if not self.classes:
            raise InputError("sizes", [], "at least one size class")
        shares("sizes.mass_share", [c.mass_share for c in self.classes])
        for before, after in zip(self.classes, self.classes[1:], strict=False):
            if after.lower < before.upper - 1e-12:
                raise InputError("sizes.lower", after.lower, f"at least {before.upper:g} m, classes in order")

    @property
    def smallest(self) -> float:
        return self.classes[0].lower

    @property
    def largest(self) -> float:
        return self.classes[-1].upper

    @property
    def number_mean_cube(self) -> float:
        """Mean of d^3 over all particles, m^3."""
        return 1.0 / sum(c.mass_share / c.number_mean_cube for c in self.classes)

    @property
    def mean_diameter(self) -> float:
        """Diameter of the particle of mean volume, m."""
        return float(self.number_mean_cube ** (1.0 / 3.0))

    @property
    def median_by_mass(self) -> float:
        """Diameter below which half of the mass lies, m."""
        below = 0.0
        for c in self.classes:
            if below + c.mass_share >= 0.5:
                return c.lower + (c.upper - c.lower) * (0.5 - below) / c.mass_share
            below += c.mass_share
        return self.largest

    def sample(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """`count` diameters (m), in random order.

        Stratified over the number distribution, so that even a few hundred particles hold the mass shares.
        """
        weights = np.array([c.mass_share / c.number_mean_cube for c in self.classes])
        cumulative = np.concatenate([[0.0], np.cumsum(weights / weights.sum())])
        u = (np.arange(count) + rng.random(count)) / count
        index = np.clip(np.searchsorted(cumulative, u, side="right") - 1, 0, len(self.classes) - 1)
        inside = (u - cumulative[index]) / np.diff(cumulative)[index]
        lower = np.array([c.lower for c in self.classes])[index]
        upper = np.array([c.upper for c in self.classes])[index]
        d = (lower**-2 - inside * (lower**-2 - upper**-2)) ** -0.5
        rng.shuffle(d)
        return np.asarray(d, dtype=np.float64)


def coarse_grain(sizes: SizeDistribution, scale: float) -> SizeDistribution:
    """All diameters times `scale` (coarse-graining: fewer, larger particles in the same container)."""
    if not (math.isfinite(scale) and scale > 0.0):
        raise InputError("scale", scale, "a positive factor")
    return SizeDistribution(
        tuple(SizeClass(c.lower * scale, c.upper * scale, c.mass_share) for c in sizes.classes)
    )


def cut_off(sizes: SizeDistribution, low: float, high: float) -> SizeDistribution:
    """Merge the mass below `low` and above `high` (m) into the neighbouring class inside.

    A class that straddles a limit is cut there and keeps its mass. Raises InputError when nothing is left.
    """
    inside = [c for c in sizes.classes if c.upper > low and c.lower < high]
    if not inside or low >= high:
        raise InputError("cut_off", (low, high), f"limits that leave a class of {sizes}")
    kept = [replace(c, lower=max(c.lower, low), upper=min(c.upper, high)) for c in inside]
    below = sum(c.mass_share for c in sizes.classes if c.upper <= low)
    above = sum(c.mass_share for c in sizes.classes if c.lower >= high)
    kept[0] = replace(kept[0], mass_share=kept[0].mass_share + below)
    kept[-1] = replace(kept[-1], mass_share=kept[-1].mass_share + above)
    return SizeDistribution(tuple(kept))


@dataclass(frozen=True)
class WallRestitution:
    """The share of a material's mass that rebounds from walls with this restitution."""

    value: float
    mass_share: float = 1.0

    def __post_init__(self) -> None:
        within("wall_restitution.value", self.value, 0.05, 1.0)
        within("wall_restitution.mass_share", self.mass_share, 1e-6, 1.0)


@dataclass(frozen=True)
class MixPart:
    """The share of a mix's mass that is this material."""

    material: str
    mass_share: float = 1.0


@dataclass(frozen=True)
class Material:
    """A granular material in SI units, with the repose angle that a calibration aims at (nan: none).

    `packing_fraction` turns the published bulk density into a particle density (physics.md section 1, choice),
    unless `grain_density` (kg/m3, of the particle itself) is given. With `parts` it is a mix (`mixed` makes it):
    the parts lie in the simulation, and sizes, densities and the rest here are the mix's as a whole.
    """

    name: str
    bulk_density: float
    packing_fraction: float
    youngs_modulus: float
    poisson_ratio: float
    long_term_damping: float
    dynamic_friction_ratio: float
    wall_restitution: tuple[WallRestitution, ...]
    sizes: SizeDistribution
    target_deg: float = math.nan
    window_deg: tuple[float, float] = (math.nan, math.nan)
    constraints: tuple[str, ...] = ()
    grain_density: float | None = None
    parts: tuple[MaterialPart, ...] = ()

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("material.name", self.name, "a name")
        within("bulk_density", self.bulk_density, 1.0, 30_000.0, "kg/m3")
        within("packing_fraction", self.packing_fraction, 0.3, 0.74)
        within("youngs_modulus", self.youngs_modulus, 1e4, 1e12, "Pa")
        within("poisson_ratio", self.poisson_ratio, 0.0, 0.5)
        within("long_term_damping", self.long_term_damping, 0.0, 2.0)
        within("dynamic_friction_ratio", self.dynamic_friction_ratio, 0.0, 1.0)
        if self.grain_density is not None:
            within("grain_density", self.grain_density, self.bulk_density, 30_000.0, "kg/m3")
        shares("wall_restitution.mass_share", [mix.mass_share for mix in self.wall_restitution])
        if self.parts:
            check_mix("parts", self.mix)
            if self.sizes != mixed_sizes(self.parts):
                raise InputError("sizes", self.sizes, "those of the mix's parts: change the parts")

    @property
    def grains(self) -> tuple[Material, ...]:
        """What lies in a simulation: the material itself, or the parts of a mix."""
        return tuple(part.material for part in self.parts) or (self,)

    @property
    def mix(self) -> tuple[MixPart, ...]:
        """The grains by name, with their shares of the mass."""
        return tuple(MixPart(p.material.name, p.mass_share) for p in self.parts) or (MixPart(self.name),)

    @property
    def particle_density(self) -> float:
        """kg/m3: as given, else bulk density over packing fraction."""
        return self.bulk_density / self.packing_fraction if self.grain_density is None else self.grain_density

    def coarse_grained(self, scale: float) -> Material:
        """The same material in particles `scale` times as large."""
        if not self.parts:
            return replace(self, sizes=coarse_grain(self.sizes, scale))
        parts = tuple(replace(p, material=p.material.coarse_grained(scale)) for p in self.parts)
        return replace(self, sizes=mixed_sizes(parts), parts=parts)


@dataclass(frozen=True)
class MaterialPart:
    """A material with its share of a mix's mass."""

    material: Material
    mass_share: float


def check_mix(field: str, parts: tuple[MixPart, ...]) -> None:
    """Raises InputError for an empty mix, a material named twice, or shares that do not sum to 1."""
    names = [part.material for part in parts]
    if not names:
        raise InputError(field, parts, "at least one material")
    for name in names:
        if names.count(name) > 1:
            raise InputError(field, name, "each material once")
    shares(f"{field}.mass_share", [part.mass_share for part in parts])


def side_by_side(mass_shares: Sequence[float], densities: Sequence[float]) -> float:
    """Density of parts that keep their own volume, 1 / sum (mass share / density)."""
    return 1.0 / sum(share / density for share, density in zip(mass_shares, densities, strict=True))


def mixed_sizes(parts: Sequence[MaterialPart]) -> SizeDistribution:
    """Mass by size of a mix; classes that overlap are cut at each other's limits."""
    pieces = [(c, part.mass_share * c.mass_share) for part in parts for c in part.material.sizes.classes]
    edges = sorted({edge for c, _ in pieces for edge in (c.lower, c.upper)})
    classes = []
    for lower, upper in zip(edges, [*edges[1:], math.inf], strict=True):
        for low, high in ((lower, lower), (lower, upper)):
            mass = math.fsum(share * _inside(c, low, high) for c, share in pieces)
            if mass > 0.0:
                classes.append(SizeClass(low, high, mass))
    return SizeDistribution(tuple(classes))


def _inside(c: SizeClass, lower: float, upper: float) -> float:
    """Share of a class's mass between two limits of which none lies inside it; a class of one size is a point."""
    if c.lower == c.upper:
        return float(lower == upper == c.lower)
    return (upper - lower) / (c.upper - c.lower) if c.lower <= lower and upper <= c.upper else 0.0


def mixed(name: str, parts: Sequence[MaterialPart], constraints: Sequence[str] = ()) -> Material:
    """A mix by mass. Assumed, because none of it is published: the parts keep the volume that they fill alone
    (sizes that differ pack closer in reality); ratio, elasticity, damping, the angle aimed at and its window are
    means by mass share. Raises InputError for shares that do not sum to 1 and for parts that are mixes themselves.
    """
    check_mix("parts", tuple(MixPart(part.material.name, part.mass_share) for part in parts))
    for part in parts:
        if part.material.parts:
            raise InputError("parts", part.material.name, "a material that is no mix itself")
    grains, mass = [part.material for part in parts], [part.mass_share for part in parts]

    def mean(values: Sequence[float]) -> float:
        return round(sum(m * v for m, v in zip(mass, values, strict=True)), 9)

    bulk = side_by_side(mass, [g.bulk_density for g in grains])
    density = side_by_side(mass, [g.particle_density for g in grains])
    at_walls: dict[float, float] = {}
    for part in parts:
        for wall in part.material.wall_restitution:
            share = part.mass_share * wall.mass_share
            at_walls[wall.value] = at_walls.get(wall.value, 0.0) + share
    return Material(
        name=name,
        bulk_density=bulk,
        packing_fraction=bulk / density,
        youngs_modulus=mean([g.youngs_modulus for g in grains]),
        poisson_ratio=mean([g.poisson_ratio for g in grains]),
        long_term_damping=mean([g.long_term_damping for g in grains]),
        dynamic_friction_ratio=mean([g.dynamic_friction_ratio for g in grains]),
        wall_restitution=tuple(WallRestitution(value, share) for value, share in at_walls.items()),
        sizes=mixed_sizes(parts),
        target_deg=mean([g.target_deg for g in grains]),
        window_deg=(mean([g.window_deg[0] for g in grains]), mean([g.window_deg[1] for g in grains])),
        constraints=tuple(constraints),
        grain_density=density,
        parts=tuple(parts),
    )


def _table() -> dict[str, dict[str, Any]]:
    text = files("demcore").joinpath("data/materials.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def material_names() -> tuple[str, ...]:
    return tuple(_table())


def load_material(name: str) -> Material:
    """The material shipped under `name`. Raises InputError for an unknown one."""
    table = _table()
    if name not in table:
        raise InputError("material", name, "one of " + ", ".join(table))
    return material_from_table(name, table)


def material_from_table(name: str, table: Mapping[str, Mapping[str, Any]]) -> Material:
    """The material `name` of a table of rows; a row with `parts` is a mix of materials of the same table."""
    row = table[name]
    if "parts" not in row:
        return material_from_row(name, row)
    parts = [
        MaterialPart(material_from_row(part["material"], table[part["material"]]), part["mass_share"])
        for part in row["parts"]
    ]
    return mixed(name, parts, row["constraints"])


def material_from_row(name: str, row: Mapping[str, Any]) -> Material:
    """A material from its table in a TOML file, whose keys name their units; see data/materials.toml."""
    sizes = tuple(SizeClass(c["lower_mm"] / 1e3, c["upper_mm"] / 1e3, c["mass_share"]) for c in row["sizes"])
    return Material(
        name=name,
        bulk_density=row["bulk_density_kg_m3"],
        packing_fraction=row["packing_fraction"],
        youngs_modulus=row["youngs_modulus_pa"],
        poisson_ratio=row["poisson_ratio"],
        long_term_damping=row["long_term_damping"],
        dynamic_friction_ratio=row["dynamic_friction_ratio"],
        wall_restitution=tuple(WallRestitution(m["value"], m["mass_share"]) for m in row["wall_restitution"]),
        sizes=SizeDistribution(sizes),
        target_deg=row["target_deg"],
        window_deg=(row["window_deg"][0], row["window_deg"][1]),
        constraints=tuple(row["constraints"]),
    )
