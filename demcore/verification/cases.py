"""Every case of physics.md section 3: CASES take a minute together, SLOW_CASES minutes each."""

from __future__ import annotations

from demcore.verification import belts, charging, chung_ooi, impact, many_particles, metamorphic, rolling
from demcore.verification.coarse_graining import coarse_graining
from demcore.verification.flow import beverloo
from demcore.verification.liggghts_pile import liggghts_pile
from demcore.verification.outcome import Case
from demcore.verification.packing import packing
from demcore.verification.silo import janssen

CASES: tuple[Case, ...] = (
    impact.normal_impact,
    impact.restitution_by_speed,
    impact.unlike_pair,
    impact.hertz_clamped,
    impact.bounce_heights,
    impact.damping_spares_impacts,
    rolling.gross_sliding,
    rolling.sliding_to_rolling,
    rolling.rolling_decay,
    rolling.rolling_incline,
    rolling.rolling_threshold,
    chung_ooi.elastic_normal,
    chung_ooi.damped_normal,
    chung_ooi.oblique,
    chung_ooi.sliding_normalised,
    chung_ooi.spinning_sphere,
    chung_ooi.opposite_spins,
    chung_ooi.unlike_spheres,
    belts.belt_drop,
    belts.head_drum,
    charging.plant_jet,
    many_particles.free_collisions,
    many_particles.settled_weight,
    metamorphic.metamorphic,
)

SLOW_CASES: tuple[Case, ...] = (
    packing,
    janssen,
    beverloo,
    coarse_graining,
    liggghts_pile,
    charging.belt_rate,
)
