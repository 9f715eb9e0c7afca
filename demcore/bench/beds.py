"""The beds that the bench times: settled spheres in a container, shipped in demcore/data/beds or in a folder.

`cylinder` and `box` are the beds of LIGGGHTS on which issue 3's rates were taken; `mono` and `ratio10` are ours
and differ in their sizes only, so that the cost of a size ratio of 10 can be read off (physics.md section 6).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import ContactModel
from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.particles import R, X, Z, spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step

SHIPPED = Path(__file__).parent.parent / "data" / "beds"

# The material of shared/reference's beds and piles.
DENSITY = 1000.0
STIFFNESS = Stiffness(1e7, 0.25)
# A linear spring as stiff as the Hertz contacts are under the weight of these beds: with 1e7 Pa it would lift them
# and half of the contacts would open.
LINEAR_STIFFNESS = Stiffness(1e6, 0.25)
RESTITUTION, FRICTION, WALL_FRICTION, ROLLING = 0.24, 0.5, 0.8, 0.48
LAWS = ("hertz", "paper")
# Steps before the clock starts, for histories to form; a bed settled under the other law needs longer to come to
# the same number of contacts.
RUN_IN = {"hertz": 100, "paper": 800}
# Simulated seconds before the clock starts where dormancy is measured: the stored beds still ring for so long.
CALM_SECONDS = 0.8

# Our own beds: so many spheres, by mass uniform between these diameters, m, or all of the same mean mass.
OWN_COUNT = 10_000
OWN_SMALLEST, OWN_LARGEST = 0.01, 0.1
OWN_SEED = 31


@dataclass(frozen=True)
class Container:
    """`shape` is a cylinder or a box; `half` its radius or half its side, m; dt the time step, s, of its rates."""

    shape: str
    half: float
    dt: float

    def walls(self) -> list[Wall]:
        """A floor at z = 0 and what stands around it, open above."""
        floor = Wall("plane")
        if self.shape == "cylinder":
            return [floor, Wall("cylinder", radius=self.half, length=100.0)]
        sides = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)]
        return [floor] + [
            Wall("plane", (-self.half * x, -self.half * y, 0.0), (x, y, z)) for x, y, z in sides
        ]


CONTAINERS = {
    "cylinder": Container("cylinder", 0.3, 5e-5),
    "box": Container("box", 0.623, 1e-4),
    "mono": Container("cylinder", 0.28, 5e-5),
    "ratio10": Container("cylinder", 0.28, 5e-5),
}


@dataclass(frozen=True)
class Bed:
    """Settled spheres: positions (N, 3) m, radii (N,) m, velocities (N, 3) m/s, spins (N, 3) rad/s."""

    name: str
    container: Container
    positions: NDArray[np.float64]
    radii: NDArray[np.float64]
    velocities: NDArray[np.float64]
    spins: NDArray[np.float64]

    def simulation(self, law: str, threaded: bool = False, dormancy: Dormancy | None = None) -> Simulation:
        """The bed under a contact law, ready to advance; no history yet, so let it run in for a while."""
        dt = self.container.dt
        if law == "paper":
            smallest = 2.0 * float(self.radii.min())
            dt = time_step(smallest, DENSITY, LINEAR_STIFFNESS.youngs_modulus, RESTITUTION, "fast")
        particles = spheres(self.positions, self.radii, DENSITY, None, self.velocities, self.spins)
        walls = wall_arrays(self.container.walls())
        model, table = contact_model(law), material_table(law)
        return Simulation(particles, walls, model, table, dt, threaded=threaded, dormancy=dormancy)


def contact_model(law: str) -> ContactModel:
    """Hertz-Mindlin with type 3 rolling, or the paper's."""
    return hertz_mindlin_model() if law == "hertz" else paper_model()


def material_table(law: str) -> MaterialTable:
    """Row 0 the walls, row 1 the spheres; dynamic friction falls to .9 of static under the paper's law only."""
    share, stiffness = (1.0, STIFFNESS) if law == "hertz" else (0.9, LINEAR_STIFFNESS)
    between = Interaction(RESTITUTION, FRICTION, share * FRICTION, ROLLING)
    at_wall = Interaction(RESTITUTION, WALL_FRICTION, share * WALL_FRICTION, ROLLING)
    return MaterialTable((stiffness, stiffness), ((at_wall, at_wall), (at_wall, between)))


def load_bed(name: str, folder: Path | None = None) -> Bed:
    """The bed `name` from NAME.npz or NAME_*.npz in `folder`, by default the shipped one.

    Keys: pos, rad and, if stored, vel and omega. Raises InputError for an unknown name, a missing file, or arrays
    that do not describe spheres inside the container.
    """
    if name not in CONTAINERS:
        raise InputError("bed", name, "one of " + ", ".join(CONTAINERS))
    place = SHIPPED if folder is None else folder
    found = [*place.glob(f"{name}.npz"), *sorted(place.glob(f"{name}_*.npz"))]
    if not found:
        raise InputError("beds", str(place), f"a folder with {name}.npz or {name}_*.npz")
    try:
        with np.load(found[0], allow_pickle=False) as stored:
            arrays = {key: np.asarray(stored[key], np.float64) for key in stored.files}
    except (OSError, ValueError) as error:
        raise InputError("beds", str(found[0]), f"an .npz file of plain arrays ({error})") from error
    return _checked(name, found[0], arrays)


def _checked(name: str, path: Path, arrays: dict[str, NDArray[np.float64]]) -> Bed:
    position, radius = arrays.get("pos"), arrays.get("rad")
    if position is None or radius is None or position.shape != (len(radius), 3) or len(radius) == 0:
        raise InputError("beds", str(path), "arrays pos (N, 3) and rad (N,), N > 0")
    bed = Bed(
        name,
        CONTAINERS[name],
        position,
        radius,
        arrays.get("vel", np.zeros_like(position)),
        arrays.get("omega", np.zeros_like(position)),
    )
    half = bed.container.half
    across = position[:, :2]
    out = np.hypot(*across.T) if bed.container.shape == "cylinder" else np.abs(across).max(axis=1)
    sound = np.isfinite(position).all() and np.isfinite(radius).all() and (radius > 0.0).all()
    if not sound or (out > half).any() or (position[:, 2] < 0.0).any():
        raise InputError("beds", str(path), f"spheres above z = 0 within {half:g} m of the axis")
    return bed


def own_radii(name: str, rng: np.random.Generator) -> NDArray[np.float64]:
    """Radii, m, of `ratio10` (diameters uniform by mass) or of `mono` (all of its mean mass).

    By mass uniform in d means by number 1/d^3, so 1/d^2 is uniform: d = (1/a^2 - u (1/a^2 - 1/b^2))^(-1/2).
    """
    lower, upper = OWN_SMALLEST**-2, OWN_LARGEST**-2
    diameter = (lower - rng.random(OWN_COUNT) * (lower - upper)) ** -0.5
    if name == "mono":
        diameter[:] = np.cbrt((diameter**3).mean())
    return diameter / 2.0


def settle(name: str, report: Callable[[str], None]) -> Bed:
    """Let `mono` or `ratio10` fall from a loose column and come to rest under Hertz-Mindlin; minutes."""
    if name not in ("mono", "ratio10"):
        raise InputError("bed", name, "mono or ratio10; the other beds were settled by LIGGGHTS")
    container = CONTAINERS[name]
    rng = np.random.default_rng(OWN_SEED)
    radius = own_radii(name, rng)
    position = fill_cylinder(radius, container.half, rng)
    still = np.zeros_like(position)
    simulation = Bed(name, container, position, radius, still, still).simulation("hertz")
    fall = float(np.sqrt(2.0 * position[:, 2].max() / 9.81))
    while simulation.time < fall + 0.6:
        simulation.advance(1000)
        report(f"{name}: {simulation.time:.2f} s of {fall + 0.6:.2f} s, {simulation.kinetic_energy:.3g} J")
    state = simulation.particles.state[np.argsort(simulation.particles.number)]
    return Bed(name, container, state[:, X : Z + 1], state[:, R], state[:, 4:7], state[:, 8:11])


def store(bed: Bed, path: Path) -> None:
    """Write a bed small: positions and radii in single, velocities in half precision."""
    np.savez_compressed(
        path,
        pos=bed.positions.astype(np.float32),
        rad=bed.radii.astype(np.float32),
        vel=bed.velocities.astype(np.float16),
    )
