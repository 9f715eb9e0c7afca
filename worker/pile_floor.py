"""How far a simulated pile is from a real one that hides nothing: the floor under every misfit of the DEM.

The rule asks for effect-free pairs with an independent code (diagnosis.md, rule 2). What there is of them: one
bed in four codes' hands, the angle by surface scan in degrees (reference data of LIGGGHTS, LAMMPS, YADE; ours by
`demcore verify --slow`)

    LIGGGHTS 35.5   demcore 35.7   LAMMPS 34.4   YADE 33.3 (with another scale of the rolling couple)

so that codes differ by 1.1 (sd); LIGGGHTS and demcore by 2.3 % in t90 and .2 % in the mass on the base. The others
are assumptions of the same kind, set so that a floor is missing nowhere; a bank of piles of another code is to
replace them (floor.estimate_floor makes a Floor of pairs). Summaries as in summaries.py.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from worker.diagnosis.floor import KEYS, Floor

# Standard deviations in the unit of the summary: what all conditions of a material share. Each one's own follows.
SHARED = {
    "angle": 1.1,
    "slope": 1.1,
    "ln_apex": 0.03,
    "ln_mass": 0.02,
    "ln_t90": 0.025,
    "ln_density": 0.02,
    "ln_d50": 0.02,
    "offset_x": 0.003,
    "offset_y": 0.003,
    "toe": 0.01,
    "curvature": 0.003,
    "dipole_c": 0.003,
    "dipole_s": 0.003,
}
# A share of the shared one: how it varies from condition to condition was never measured.
OWN_SHARE = 0.4


@cache
def pile_floor() -> Floor:
    """Independent between summaries, since nothing says how they go together."""
    sd = np.array([SHARED.get(name, 0.0) if test == "pile" else 0.0 for test, name in KEYS])
    return Floor(np.diag(sd**2), np.diag((OWN_SHARE * sd) ** 2))
