"""One pile test by LIGGGHTS: its input files, the run, and what is read back. Imports nothing of the analyser.

Source of the syntax: the manual of LIGGGHTS-PUBLIC 3.8 (the keywords stand in the order model, tangential,
cohesion, rolling_friction). A loose column of spheres falls into a cylinder on a round plate and settles; the
cylinder vanishes or rises; what leaves the plate falls out of the box. Lengths m, masses kg, times s.
"""

from __future__ import annotations

import math
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PROGRAM = "liggghts"
GRAVITY = 9.81
# The box ends here: below the plate, and so many of its radii from its axis.
FLOOR, REACH = -0.1, 4.0
SOLID_OF_COLUMN, ABOVE = 0.15, 0.2
SHARE_OF_RAYLEIGH = 0.2
SETTLE, DISCHARGE, LOOK = 0.8, 2.0, 0.005
# A risen tube hangs so high over the plate, out of the way of every heap.
LIFT = 0.8
POISSON = 0.25
FACETS = 72
# s, on a machine that is busy with other things.
LONGEST_RUN = 3600.0
# Liquid bridges: angle of contact, volume by that of a grain, and how far a bridge is drawn, in radii.
BRIDGE_ANGLE, BRIDGE_VOLUME = 0.0, 1e-3


class LiggghtsFailed(Exception):
    """The program ended with an error or left no pile."""


@dataclass(frozen=True)
class Contacts:
    """What a grain does at a grain and at steel. `rolling_model` is `epsd2` or `cdt`; `youngs` Pa."""

    friction: float
    wall_friction: float
    restitution: float
    rolling: float
    wall_restitution: float = 0.35
    rolling_model: str = "epsd2"
    youngs: float = 1e7


@dataclass(frozen=True)
class Pile:
    """One run. `lift` m/s, 0: the cylinder vanishes at once. `psd`: sizes with shares of the mass.

    What may be hidden: `base_friction` other than the cylinder's, the cylinder `aside` of the plate's middle
    (x, y), bridges of `surface_tension` (N/m) between grains, a `rim` around the plate (height, m), sizes that
    `spread` (sizes()), grains of two equal spheres whose middles lie `clump` of their diameter apart (0: spheres).
    """

    contacts: Contacts
    mass: float
    psd: tuple[tuple[float, float], ...]
    density: float
    base_radius: float
    cylinder_radius: float
    seed: int
    lift: float = 0.0
    drop_height: float = 0.0
    base_friction: float | None = None
    aside: tuple[float, float] = (0.0, 0.0)
    surface_tension: float = 0.0
    rim: float = 0.0
    spread: float = 0.0
    clump: float = 0.0

    @property
    def grain_per_sphere(self) -> float:
        """Diameter of the sphere of a grain's volume by that of the spheres it is made of: two less their lens."""
        a = self.clump
        return (2.0 - 0.5 * (2.0 + a) * (1.0 - a) ** 2) ** (1.0 / 3.0) if a else 1.0

    @property
    def mass_per_sphere(self) -> float:
        """Of a sphere of a grain, by density and diameter cubed."""
        return self.density * math.pi / 6.0 * self.grain_per_sphere**3 / (2.0 if self.clump else 1.0)


@dataclass(frozen=True)
class Heap:
    """Position (n, 3) and radius (n,) of all grains that are left, height of the settled column, and the mass in
    the box (k,) at times after the removal (k,)."""

    position: Array
    radius: Array
    fill_height: float
    time: Array
    mass: Array


def sizes(pile: Pile, stream: np.random.Generator) -> Array:
    """Diameters of a sample of the stated mass: each stated size is a sieve class of 10 % to either side.

    `spread` widens it about its median by mass: where mass is lognormal about mu, numbers are about mu - 3 sd^2
    (Hatch & Choate 1929).
    """
    size, share = (np.array(column) for column in zip(*pile.psd, strict=True))
    middle = float(np.exp(np.sum(share * np.log(size)) / np.sum(share)))
    number = share / size**3
    found: list[float] = []
    left = pile.mass
    while left > 0.0:
        d = float(stream.choice(size, p=number / number.sum())) * float(stream.uniform(1 / 1.1, 1.1))
        if pile.spread:
            d *= math.exp(pile.spread * float(stream.standard_normal()) - 3.0 * pile.spread**2)
        d = min(max(d, 0.4 * middle), 2.0 * middle)
        found.append(d)
        left -= pile.density * math.pi / 6.0 * d**3
    return np.array(found)


def loose_column(diameter: Array, radius: float, density: float, stream: np.random.Generator) -> Array:
    """Places (n, 3) that do not overlap, in a column of the cylinder's radius about the z axis."""
    volume = float(np.sum(diameter**3)) * math.pi / 6.0
    top = volume / SOLID_OF_COLUMN / (math.pi * radius**2) + 2.0 * float(diameter.max())
    places, radii = np.empty((0, 3)), np.empty(0)
    for r in np.sort(diameter)[::-1] / 2.0:
        while True:
            rho, angle = (radius - 1.05 * r) * math.sqrt(stream.random()), 2.0 * math.pi * stream.random()
            place = np.array([rho * math.cos(angle), rho * math.sin(angle), stream.uniform(1.05 * r, top)])
            if np.all(np.sum((places - place) ** 2, axis=1) > (radii + r) ** 2):
                break
        places, radii = np.vstack([places, place]), np.append(radii, r)
    return np.column_stack([places, radii])


def ring(radius: float, low: float, high: float) -> list[Array]:
    """Triangles (3, 3) of an upright tube."""
    angle = 2.0 * math.pi * np.arange(FACETS + 1) / FACETS
    # The polygon's middles touch the circle, so that no grain sits closer to the axis than it may.
    wide = radius / math.cos(math.pi / FACETS)
    x, y = wide * np.cos(angle), wide * np.sin(angle)
    found = []
    for k in range(FACETS):
        a, b = (x[k], y[k]), (x[k + 1], y[k + 1])
        found.append(np.array([(*a, low), (*b, low), (*b, high)]))
        found.append(np.array([(*a, low), (*b, high), (*a, high)]))
    return found


def plate(radius: float) -> list[Array]:
    """Triangles of a round plate at z = 0."""
    angle = 2.0 * math.pi * np.arange(FACETS + 1) / FACETS
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return [np.array([(0, 0, 0), (x[k], y[k], 0), (x[k + 1], y[k + 1], 0)]) for k in range(FACETS)]


def as_stl(triangles: list[Array]) -> str:
    lines = ["solid part"]
    for t in triangles:
        n = np.cross(t[1] - t[0], t[2] - t[0])
        n = n / np.linalg.norm(n)
        lines += ["facet normal {:.9g} {:.9g} {:.9g}".format(*n), "outer loop"]
        lines += ["vertex {:.9g} {:.9g} {:.9g}".format(*corner) for corner in t]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part"]) + "\n"


def top_of(column: Array) -> float:
    """The height under which all is that falls."""
    return float(column[:, 2].max()) + ABOVE


def smallest_sphere(pile: Pile, column: Array) -> float:
    """Radius of the smallest sphere."""
    if not pile.clump:
        return float(column[:, 3].min())
    return 0.5 * min(size for size, _ in pile.psd) / 1.06 / pile.grain_per_sphere


def _empty_box(pile: Pile, top: float) -> list[str]:
    (x0, x1), (y0, y1), (z0, z1) = _box(pile, top)
    return [f"region all block {x0} {x1} {y0} {y1} {z0} {z1} units box", "create_box 3 all"]


def _box(pile: Pile, top: float) -> tuple[tuple[float, float], ...]:
    half = REACH * pile.base_radius
    return (-half, half), (-half, half), (FLOOR, 2.5 * top)


def data_file(pile: Pile, column: Array, top: float) -> str:
    """The column in LIGGGHTS' data format, atom style granular; the grains enter with the speed of their fall."""
    speed = -math.sqrt(2.0 * GRAVITY * pile.drop_height)
    ends = zip(_box(pile, top), "xyz", strict=True)
    lines = [
        "column\n",
        f"{len(column)} atoms",
        "3 atom types\n",
        *(f"{low} {high} {axis}lo {axis}hi" for (low, high), axis in ends),
        "\nAtoms\n",
    ]
    for k, (x, y, z, r) in enumerate(column.tolist(), start=1):
        place = f"{x + pile.aside[0]!r} {y + pile.aside[1]!r} {z!r}"
        lines.append(f"{k} 1 {2.0 * r!r} {pile.density!r} {place}")
    lines.append("\nVelocities\n")
    lines += [f"{k} 0 0 {speed!r} 0 0 0" for k in range(1, len(column) + 1)]
    return "\n".join(lines) + "\n"


def time_step(pile: Pile, smallest: float) -> float:
    """A share of the Rayleigh time of the smallest grain."""
    shear = pile.contacts.youngs / (2.0 * (1.0 + POISSON))
    whole = math.pi * smallest * math.sqrt(pile.density / shear) / (0.1631 * POISSON + 0.8766)
    return SHARE_OF_RAYLEIGH * whole


def _table(grain: float, base: float, cylinder: float) -> str:
    """A symmetric 3 x 3 table: grains, base, cylinder; steel never meets steel."""
    rows = [(grain, base, cylinder), (base, base, base), (cylinder, base, cylinder)]
    return "peratomtypepair 3 " + " ".join(str(value) for row in rows for value in row)


def input_script(pile: Pile, column: Array) -> str:
    """Grains are type 1, the plate type 2, the cylinder type 3."""
    c = pile.contacts
    smallest, top = smallest_sphere(pile, column), top_of(column)
    dt = time_step(pile, smallest)
    fall = math.sqrt(2.0 * top / GRAVITY)
    settle, look = round((fall + SETTLE) / dt), round(LOOK / dt)
    wet = pile.surface_tension > 0.0
    bridges = "cohesion sjkr " if wet else ""
    walls = f"model hertz tangential history rolling_friction {c.rolling_model}"
    grains = f"model hertz tangential history {bridges}rolling_friction {c.rolling_model}"
    # The pull-off force of a bridge, 4 pi R gamma, spread over the area of a contact that carries four weights.
    density = cohesion_energy(pile, column) if wet else 0.0
    base = c.wall_friction if pile.base_friction is None else pile.base_friction
    lines = [
        "atom_style granular",
        "atom_modify map array",
        "boundary f f f",
        "newton off",
        "communicate single vel yes",
        "units si",
        *(_empty_box(pile, top) if pile.clump else ["read_data column.data"]),
        f"neighbor {1.0 * smallest} bin",
        "neigh_modify delay 0",
        f"fix m1 all property/global youngsModulus peratomtype {c.youngs} {c.youngs} {c.youngs}",
        f"fix m2 all property/global poissonsRatio peratomtype {POISSON} {POISSON} {POISSON}",
        "fix m3 all property/global coefficientRestitution "
        + _table(c.restitution, c.wall_restitution, c.wall_restitution),
        "fix m4 all property/global coefficientFriction " + _table(c.friction, base, c.wall_friction),
        "fix m5 all property/global coefficientRollingFriction " + _table(c.rolling, c.rolling, c.rolling),
        *(["fix m6 all property/global cohesionEnergyDensity " + _table(density, 0.0, 0.0)] if wet else []),
        f"pair_style gran {grains}",
        "pair_coeff * *",
        f"timestep {dt!r}",
        f"fix weight all gravity {GRAVITY} vector 0.0 0.0 -1.0",
        "fix plate all mesh/surface file plate.stl type 2",
        *_cylinder(pile, walls),
        *(_clumps(pile, top - ABOVE) if pile.clump else ["fix move all nve/sphere"]),
        "variable m equal mass(all)",
        "thermo_style custom step atoms v_m",
        "thermo_modify lost ignore norm no",
        f"thermo {look}",
        f"run {settle}",
        "write_dump all custom filled.dump id x y z radius",
    ]
    if pile.lift:
        lines.append(f"fix rise all move/mesh mesh tube linear 0.0 0.0 {pile.lift!r}")
        lines += [f"run {round(LIFT / pile.lift / dt)}", "unfix rise"]
    else:
        lines.append("unfix side")
    lines += [f"run {round(DISCHARGE / dt)}", "write_dump all custom heap.dump id x y z radius"]
    return "\n".join(lines) + "\n"


def _cylinder(pile: Pile, walls: str) -> list[str]:
    """A tube that rises is a mesh, in the one wall of meshes that the program allows; one that vanishes is not."""
    if pile.lift:
        return [
            "fix tube all mesh/surface file tube.stl type 3",
            f"fix bottom all wall/gran {walls} mesh n_meshes 2 meshes plate tube",
        ]
    x, y = pile.aside
    return [
        f"fix bottom all wall/gran {walls} mesh n_meshes 1 meshes plate",
        f"fix side all wall/gran {walls} primitive type 3 zcylinder {pile.cylinder_radius} {x} {y}",
    ]


def _clumps(pile: Pile, top: float) -> list[str]:
    """Grains of two spheres, put into the column by the program itself, of the stated mass; rigid bodies.

    A template for three sizes of each sieve class. Its seeds have to be primes above 10,000.
    """
    lines, chosen = [], []
    for k, (size, share) in enumerate(pile.psd):
        for j, within in enumerate((1.0 / 1.06, 1.0, 1.06)):
            d, number = size * within / pile.grain_per_sphere, 3 * k + j + 1
            away = 0.5 * pile.clump * d
            spheres = f"{-away!r} 0.0 0.0 {0.5 * d!r} {away!r} 0.0 0.0 {0.5 * d!r}"
            lines.append(
                f"fix grain{number} all particletemplate/multisphere {_prime(10_007 + 100 * number)} atom_type 1 "
                f"density constant {pile.density} nspheres 2 ntry 100000 spheres {spheres} type {number}"
            )
            chosen.append(f"grain{number} {share / 3.0!r}")
    x, y = pile.aside
    speed = -math.sqrt(2.0 * GRAVITY * pile.drop_height)
    return [
        *lines,
        f"fix grains all particledistribution/discrete {_prime(20_011)} {len(chosen)} " + " ".join(chosen),
        f"region column cylinder z {x} {y} {pile.cylinder_radius} 0.0 {top!r} units box",
        f"fix fill all insert/pack seed {_prime(30_011 + 50 * pile.seed)} distributiontemplate grains "
        f"maxattempt 500 insert_every once overlapcheck yes all_in yes vel constant 0.0 0.0 {speed!r} "
        f"region column mass_in_region {pile.mass}",
        "fix move all multisphere allow_group_and_set yes",
    ]


def _prime(least: int) -> int:
    """The first prime from there on."""
    while any(least % d == 0 for d in range(2, math.isqrt(least) + 1)):
        least += 1
    return least


def cohesion_energy(pile: Pile, column: Array) -> float:
    """J/m3 of `sjkr` (force per contact area): 4 pi R gamma at the Hertz contact that carries four weights."""
    r = float(np.median(column[:, 3]))
    weight = pile.density * 4.0 / 3.0 * math.pi * r**3 * GRAVITY
    effective = pile.contacts.youngs / (2.0 * (1.0 - POISSON**2))
    overlap = (4.0 * weight * 3.0 / (4.0 * effective * math.sqrt(0.5 * r))) ** (2.0 / 3.0)
    return 4.0 * math.pi * 0.5 * r * pile.surface_tension / (math.pi * r * overlap)


def _dump(path: Path) -> Array:
    rows = path.read_text().partition("ITEM: ATOMS")[2].splitlines()[1:]
    return np.array([[float(word) for word in row.split()[1:5]] for row in rows]).reshape(-1, 4)


def run(pile: Pile) -> Heap:
    """In a folder that is removed again. Raises LiggghtsFailed."""
    stream = np.random.default_rng(np.random.SeedSequence([pile.seed, 41]))
    column = loose_column(sizes(pile, stream), pile.cylinder_radius, pile.density, stream)
    top = top_of(column)
    with tempfile.TemporaryDirectory(prefix="pile-") as place:
        folder = Path(place)
        (folder / "column.data").write_text(data_file(pile, column, top))
        (folder / "in.pile").write_text(input_script(pile, column))
        flat = plate(pile.base_radius) + (ring(pile.base_radius, 0.0, pile.rim) if pile.rim else [])
        (folder / "plate.stl").write_text(as_stl(flat))
        tube = [t + np.array([*pile.aside, 0.0]) for t in ring(pile.cylinder_radius, 0.001, top)]
        (folder / "tube.stl").write_text(as_stl(tube))
        command = [PROGRAM, "-in", "in.pile", "-log", "none"]
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LONGEST_RUN,
            check=False,
        )
        if not (folder / "heap.dump").is_file():
            raise LiggghtsFailed(re.findall(r"ERROR[^\n]*", done.stdout + done.stderr) or done.stdout[-500:])
        filled, heap = _dump(folder / "filled.dump"), _dump(folder / "heap.dump")
    rows = np.array(
        [[float(w) for w in r] for r in re.findall(r"^ +(\d+) +(\d+) +(\S+) *$", done.stdout, re.MULTILINE)]
    )
    dt = time_step(pile, smallest_sphere(pile, column))
    removed = round((math.sqrt(2.0 * top / GRAVITY) + SETTLE) / dt)
    after = rows[rows[:, 0] >= removed]
    height = float(np.quantile(filled[:, 2] + filled[:, 3], 0.95))
    return Heap(heap[:, :3], heap[:, 3], height, (after[:, 0] - removed) * dt, after[:, 2])
