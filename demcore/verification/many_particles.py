"""Clouds and beds: momentum and energy, which no contact law may change or create, and the weight on walls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from demcore.case import Interaction
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import ContactModel
from demcore.particles import VX, VZ, Floats, M
from demcore.simulation import Simulation
from demcore.verification.beds import G, column, fall_time, run_to_rest, tube, wall_push
from demcore.verification.outcome import SECTION_3, Outcome

FAMILIES = {"paper's law": paper_model, "Hertz-Mindlin": hertz_mindlin_model}
ROUGH = Interaction(0.6, 0.5, 0.45, 0.2)
ELASTIC = Interaction(1.0, 0.0, 0.0, 0.0)


def sizes(count: int, seed: int) -> Floats:
    """Radii from 5 to 15 mm."""
    return np.random.default_rng([5, seed]).uniform(0.005, 0.015, count)


def cloud(contact: Interaction, model: ContactModel) -> Simulation:
    """120 spheres in free space, without overlaps, flying at random."""
    s = column(sizes(120, 1), 0.06, 1, [], contact, model)
    s.gravity[:] = 0.0
    s.particles.state[:, VX : VZ + 1] = np.random.default_rng(2).normal(size=(120, 3))
    return s


def free_collisions() -> Iterator[Outcome]:
    """Momentum kept to 1e-12; rough grains only lose energy; smooth elastic ones have it all back once apart."""
    for family, model in FAMILIES.items():
        s = cloud(ROUGH, model())
        before, first = _momentum(s), s.kinetic_energy
        size = float(np.abs(s.particles.state[:, [M]] * s.particles.state[:, VX : VZ + 1]).sum())
        most = 0.0
        for _ in range(40):
            s.advance(50)
            most = max(most, s.kinetic_energy)
        drift = float(np.abs(_momentum(s) - before).max()) / size
        yield Outcome(f"free collisions, {family}: momentum drift", SECTION_3, 0.0, drift, 1e-12)
        gained = max(0.0, most / first - 1.0)
        yield Outcome(f"free collisions, {family}: energy gained", SECTION_3, 0.0, gained, 1e-12)
        lost = 1.0 if s.kinetic_energy < 0.8 * first else 0.0
        yield Outcome(f"free collisions, {family}: a fifth of the energy lost", SECTION_3, 1.0, lost, 0.0)
        smooth = cloud(ELASTIC, model())
        smooth.dt *= 0.25
        first = smooth.kinetic_energy
        smooth.advance(8000)
        kept = smooth.kinetic_energy / first
        yield Outcome(f"free elastic collisions, {family}: energy kept", SECTION_3, 1.0, kept, 0.005)


def _momentum(s: Simulation) -> Floats:
    state = s.particles.state
    total: Floats = (state[:, [M]] * state[:, VX : VZ + 1]).sum(axis=0)
    return total


def settled_weight() -> Iterator[Outcome]:
    """Wall forces of a settled bed carry its weight, with and without friction on the tube."""
    for family, model in FAMILIES.items():
        for mu in (0.0, 0.5):
            contact = Interaction(0.3, mu, mu, 0.1)
            s = column(sizes(200, 3), 0.06, 3, tube(0.06), contact, model())
            run_to_rest(s, fall_time(s) + 0.5, 4.0)
            weight = G * float(s.particles.state[:, M].sum())
            carried = []
            for _ in range(40):
                s.advance(50)
                carried.append(sum(float(wall_push(s, wall)[:, 2].sum()) for wall in (0, 1)))
            got = float(np.mean(carried)) / weight
            yield Outcome(
                f"settled bed, {family}, mu = {mu:g}: walls carry the weight", SECTION_3, 1.0, got, 0.005
            )
