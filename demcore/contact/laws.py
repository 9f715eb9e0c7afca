"""The library of laws: which NamedTuple selects which implementation, and the two families built from them.

A law is registered by its line in the table of its kind; the conformance suite (tests/demcore/contact) takes
every law from these tables.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from demcore.contact.coulomb_spring import CoulombSpring, coulomb_spring
from demcore.contact.dry import Dry, dry
from demcore.contact.hertz import Hertz, hertz_normal
from demcore.contact.hysteretic_spring import HystereticLinearSpring, hysteretic_normal
from demcore.contact.linear_cohesion import LinearCohesion, linear_cohesion
from demcore.contact.liquid_bridge import LiquidBridge, liquid_bridge
from demcore.contact.mindlin_spring import MindlinSpring, mindlin_spring
from demcore.contact.model import ContactModel
from demcore.contact.still_air import StillAir, still_air
from demcore.contact.type3_rolling import Type3Rolling, type3_rolling
from demcore.contact.vacuum import Vacuum, vacuum
from demcore.contact.velocity_hysteretic_spring import VelocityHystereticSpring, velocity_hysteretic_normal
from demcore.jit import law_dispatch

Laws = dict[Any, Callable[..., Any]]

NORMAL: Laws = {
    HystereticLinearSpring: hysteretic_normal,
    VelocityHystereticSpring: velocity_hysteretic_normal,
    Hertz: hertz_normal,
}
TANGENTIAL: Laws = {CoulombSpring: coulomb_spring, MindlinSpring: mindlin_spring}
ROLLING: Laws = {Type3Rolling: type3_rolling}
COHESION: Laws = {Dry: dry, LinearCohesion: linear_cohesion, LiquidBridge: liquid_bridge}
FIELD: Laws = {Vacuum: vacuum, StillAir: still_air}


def normal_force(law: Any, *arguments: Any) -> Any:
    """The normal law of `law`'s type; see its module."""
    return NORMAL[type(law)](law, *arguments)


def tangential_force(law: Any, *arguments: Any) -> Any:
    """The tangential law of `law`'s type; see its module."""
    return TANGENTIAL[type(law)](law, *arguments)


def rolling_couple(law: Any, *arguments: Any) -> Any:
    """The rolling law of `law`'s type; see its module."""
    return ROLLING[type(law)](law, *arguments)


def cohesion_force(law: Any, *arguments: Any) -> Any:
    """The cohesion law of `law`'s type; see its module."""
    return COHESION[type(law)](law, *arguments)


def field_wrench(law: Any, *arguments: Any) -> Any:
    """The field law of `law`'s type; see its module."""
    return FIELD[type(law)](law, *arguments)


law_dispatch(NORMAL, normal_force)
law_dispatch(TANGENTIAL, tangential_force)
law_dispatch(ROLLING, rolling_couple)
law_dispatch(COHESION, cohesion_force)
law_dispatch(FIELD, field_wrench)

DRY, VACUUM = Dry(), Vacuum()


def paper_model(long_term_damping: float = 0.5, cohesion: Any = DRY, field: Any = VACUUM) -> ContactModel:
    """Hysteretic linear spring, linear spring Coulomb limit, type 3 rolling (physics.md section 1)."""
    normal = HystereticLinearSpring(damping=long_term_damping)
    return ContactModel(normal, CoulombSpring(), Type3Rolling(), cohesion, field)


def hertz_mindlin_model(limit_force: bool = False, cohesion: Any = DRY, field: Any = VACUUM) -> ContactModel:
    """Hertz-Mindlin with history, Coulomb cap, type 3 rolling (physics.md section 2).

    Mindlin's tangential stiffness 8 G* sqrt(R s) comes with the normal law.
    """
    normal = Hertz(1.0 if limit_force else 0.0)
    return ContactModel(normal, MindlinSpring(), Type3Rolling(), cohesion, field)
