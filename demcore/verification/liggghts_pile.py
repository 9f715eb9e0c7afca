"""The same pile as another code: three seeds of ours against two of LIGGGHTS 3.8.

Source of the expected numbers: the two reference piles (7,838 spheres of 20, 40 and 60 mm), read with our own
surface scan; that is 35.6 and 35.4 degrees, 33.4 and 33.5 kg on the base. t90 is the time after the removal of
the cylinder until 90 % of all particles that left were .1 m below the base.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import hertz_mindlin_model
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from demcore.material import SizeClass, SizeDistribution
from demcore.observables.repose_angle import scan_heights, surface_scan
from demcore.particles import M, R, X, Z, spheres
from demcore.simulation import Simulation
from demcore.verification.beds import fall_time, run_to_rest
from demcore.verification.outcome import Outcome, share_of

SOURCE = "LIGGGHTS 3.8, two seeds"
ANGLE_DEG = (35.60 + 35.43) / 2
MASS_KG = (33.447 + 33.515) / 2
T90_S = (0.794 + 0.784) / 2

COUNT, DENSITY, DT = 7838, 1000.0, 5e-5
CYLINDER_RADIUS, BASE_RADIUS = 0.3, 0.375
SIZES = SizeDistribution(
    tuple(SizeClass(d, d, share) for d, share in ((0.02, 0.2), (0.04, 0.5), (0.06, 0.3)))
)
GRAINS = Interaction(0.24, 0.5, 0.5, 0.48)
STEEL = Interaction(0.24, 0.8, 0.8, 0.48)
CYLINDER = 1
AFTER_REMOVAL, INTERVAL = 5.0, 0.005
SEEDS = (1, 2, 3)


def make_pile(seed: int) -> tuple[float, float, float]:
    """Fill, settle, take the cylinder away, 5 s: scanned angle (deg), mass on the base (kg), t90 (s)."""
    rng = np.random.default_rng([77, seed])
    radius = 0.5 * SIZES.sample(COUNT, rng)
    position = fill_cylinder(radius, CYLINDER_RADIUS, rng)
    top = float(position[:, 2].max()) + 0.1
    walls = [Wall("disc", radius=BASE_RADIUS), Wall("cylinder", radius=CYLINDER_RADIUS, length=top)]
    grain = Stiffness(1e7, 0.25)
    s = Simulation(
        spheres(position, radius, DENSITY),
        wall_arrays(walls),
        hertz_mindlin_model(),
        MaterialTable((grain, grain), ((STEEL, STEEL), (STEEL, GRAINS))),
        DT,
        floor=-0.1,
        reach=0.8,
    )
    run_to_rest(s, fall_time(s) + 0.2, 4.0)
    s.remove_wall(CYLINDER)
    counts = []
    for _ in range(round(AFTER_REMOVAL / INTERVAL)):
        s.advance(round(INTERVAL / DT))
        counts.append(s.count)
    state = s.particles.state
    state = state[(np.hypot(state[:, X], state[:, X + 1]) < BASE_RADIUS) & (state[:, Z] > 0.0)]
    angle = surface_scan(scan_heights(state[:, X : Z + 1], state[:, R], BASE_RADIUS), BASE_RADIUS)
    left = COUNT - np.array(counts)
    t90 = INTERVAL * (1 + int(np.searchsorted(left, 0.9 * left[-1])))
    return angle.mean, float(state[:, M].sum()), t90


def liggghts_pile() -> Iterator[Outcome]:
    """Means of three seeds: angle within 1.5 degrees, mass on the base within 6 %, t90 within 10 %.

    One pile scatters by .7 degrees here and by .2 to .9 in the reference runs, so single seeds are no measure.
    """
    angle, mass, t90 = np.mean([make_pile(seed) for seed in SEEDS], axis=0)
    yield Outcome("pile as LIGGGHTS, three seeds: angle / deg", SOURCE, ANGLE_DEG, float(angle), 1.5)
    yield share_of("pile as LIGGGHTS, three seeds: mass on the base / kg", SOURCE, MASS_KG, float(mass), 0.06)
    yield share_of("pile as LIGGGHTS, three seeds: t90 / s", SOURCE, T90_S, float(t90), 0.10)
