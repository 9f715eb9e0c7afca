"""The same problem in other words: another frame, another order, another scale. No expected number is needed.

A column of 100 spheres falls into a tube. For .1 s its collisions are few enough that particle by particle the
runs agree to rounding; later rounding grows with every collision, and the bed's centre of mass is compared.

Similarity: sizes l, Young's modulus l E, times sqrt(l) t, at one density and gravity, leave every ratio of forces
as it is (physics.md section 3). The creep speed of the friction law is a speed, so it takes sqrt(l) too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import ContactModel
from demcore.geometry.wall_arrays import wall_arrays
from demcore.insertion import fill_cylinder
from demcore.particles import Floats, M, X, Z, spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step
from demcore.verification.beds import DENSITY, POISSON, YOUNGS, G, tube
from demcore.verification.outcome import SECTION_3, Outcome

COUNT = 100
TUBE = 0.06
CONTACT = Interaction(0.5, 0.5, 0.45, 0.2)
EARLY, LATE = 0.1, 0.7
FAMILIES = {"paper's law": paper_model, "Hertz-Mindlin": hertz_mindlin_model}


def rotation(axis: tuple[float, float, float], angle: float) -> Floats:
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = np.array(axis) / math.sqrt(sum(a * a for a in axis))
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Floats = np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k)
    return turn


@dataclass(frozen=True)
class Wording:
    """How the one problem is put: turned, shifted (m), scaled, its particles listed in another order."""

    turn: Floats
    shift: Floats
    scale: float
    order: NDArray[np.int64]


PLAIN = Wording(np.eye(3), np.zeros(3), 1.0, np.arange(COUNT))
OTHERS = {
    "turned frame": Wording(rotation((1.0, 2.0, -0.5), 1.1), np.zeros(3), 1.0, np.arange(COUNT)),
    "shifted frame": Wording(np.eye(3), np.array([3.7, -1.3, 0.9]), 1.0, np.arange(COUNT)),
    "other particle order": Wording(np.eye(3), np.zeros(3), 1.0, np.random.default_rng(8).permutation(COUNT)),
    "three times the size": Wording(np.eye(3), np.zeros(3), 3.0, np.arange(COUNT)),
}


def falling(model: ContactModel, wording: Wording) -> Simulation:
    """The falling column as `wording` puts it."""
    rng = np.random.default_rng(4)
    radius = rng.uniform(0.005, 0.015, COUNT)
    position = fill_cylinder(radius, TUBE, rng)
    velocity, spin = rng.normal(0.0, 0.2, (COUNT, 3)), rng.normal(0.0, 5.0, (COUNT, 3))
    size, order, turn = wording.scale, wording.order, wording.turn
    swift = math.sqrt(size)
    creep = model.tangential.creep_speed * swift
    return Simulation(
        spheres(
            (size * position @ turn.T + wording.shift)[order],
            (size * radius)[order],
            DENSITY,
            velocity=(swift * velocity @ turn.T)[order],
            spin=(spin / swift @ turn.T)[order],
        ),
        wall_arrays(tube(size * TUBE, turn @ np.array([0.0, 0.0, 1.0]), wording.shift)),
        model._replace(tangential=model.tangential._replace(creep_speed=creep)),
        uniform_table(Stiffness(size * YOUNGS, POISSON), CONTACT),
        time_step(0.01, DENSITY, YOUNGS, CONTACT.restitution) * swift,
        gravity=turn @ np.array([0.0, 0.0, -G]),
    )


def plain_positions(s: Simulation, wording: Wording) -> Floats:
    """Positions (N, 3), m, put back into the plain wording."""
    rows = s.particles.state[np.argsort(s.particles.number)]
    position = np.empty((COUNT, 3))
    position[wording.order] = (rows[:, X : Z + 1] - wording.shift) @ wording.turn / wording.scale
    return position


def metamorphic() -> Iterator[Outcome]:
    """Largest distance between the two runs in particle radii, early; heights of the centre of mass, late."""
    for family, build in FAMILIES.items():
        plain = falling(build(), PLAIN)
        dt = plain.dt
        plain.advance(round(EARLY / dt))
        early = plain_positions(plain, PLAIN)
        plain.advance(round((LATE - EARLY) / dt))
        late = _height(plain, PLAIN)
        for name, wording in OTHERS.items():
            other = falling(build(), wording)
            other.advance(round(EARLY / dt))
            apart = float(np.abs(plain_positions(other, wording) - early).max()) / 0.005
            yield Outcome(f"{name}, {family}: apart at {EARLY:g} s / radii", SECTION_3, 0.0, apart, 1e-6)
            other.advance(round((LATE - EARLY) / dt))
            yield Outcome(
                f"{name}, {family}: height of the bed / m",
                SECTION_3,
                late,
                _height(other, wording),
                0.02 * late,
            )


def _height(s: Simulation, wording: Wording) -> float:
    """Height of the centre of mass in the plain wording, m."""
    mass = np.empty(COUNT)
    mass[wording.order] = s.particles.state[np.argsort(s.particles.number), M]
    return float((mass @ plain_positions(s, wording)[:, 2]) / mass.sum())
