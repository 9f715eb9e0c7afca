"""The library of laws: which NamedTuple selects which implementation, and the two families built from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from demcore.contact.coulomb_spring import CoulombSpring, coulomb_spring
from demcore.contact.hertz import Hertz, hertz_normal
from demcore.contact.hysteretic_spring import HystereticLinearSpring, hysteretic_normal
from demcore.contact.model import ContactModel
from demcore.contact.type3_rolling import Type3Rolling, type3_rolling
from demcore.jit import law_dispatch

Laws = dict[Any, Callable[..., Any]]

NORMAL: Laws = {HystereticLinearSpring: hysteretic_normal, Hertz: hertz_normal}
TANGENTIAL: Laws = {CoulombSpring: coulomb_spring}
ROLLING: Laws = {Type3Rolling: type3_rolling}


def normal_force(law: Any, *arguments: Any) -> Any:
    """The normal law of `law`'s type; see its module."""
    return NORMAL[type(law)](law, *arguments)


def tangential_force(law: Any, *arguments: Any) -> Any:
    """The tangential law of `law`'s type; see its module."""
    return TANGENTIAL[type(law)](law, *arguments)


def rolling_couple(law: Any, *arguments: Any) -> Any:
    """The rolling law of `law`'s type; see its module."""
    return ROLLING[type(law)](law, *arguments)


law_dispatch(NORMAL, normal_force)
law_dispatch(TANGENTIAL, tangential_force)
law_dispatch(ROLLING, rolling_couple)


def paper_model(long_term_damping: float = 0.5) -> ContactModel:
    """Hysteretic linear spring, linear spring Coulomb limit, type 3 rolling (physics.md section 1)."""
    return ContactModel(HystereticLinearSpring(damping=long_term_damping), CoulombSpring(), Type3Rolling())


def hertz_mindlin_model(limit_force: bool = False) -> ContactModel:
    """Hertz-Mindlin with history, Coulomb cap, type 3 rolling (physics.md section 2).

    Mindlin's tangential stiffness 8 G* sqrt(R s) comes with the normal law.
    """
    return ContactModel(Hertz(1.0 if limit_force else 0.0), CoulombSpring(), Type3Rolling())
