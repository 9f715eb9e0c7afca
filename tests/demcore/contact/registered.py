"""Every registered law as an instance, and what the suite feeds it. A new law is tested by being registered."""

from __future__ import annotations

import math

import numpy as np

from demcore.contact import laws
from demcore.contact.coulomb_spring import CoulombSpring
from demcore.contact.hysteretic_spring import HystereticLinearSpring
from demcore.contact.laws import DRY, VACUUM
from demcore.contact.model import Body, ContactModel, Normal, Pair, Vec3
from demcore.contact.type3_rolling import Type3Rolling

KINDS = {
    "normal": laws.NORMAL,
    "tangential": laws.TANGENTIAL,
    "rolling": laws.ROLLING,
    "cohesion": laws.COHESION,
    "field": laws.FIELD,
}
# A numeric without a default gets this: it must be a sensible strength for grains of a centimetre.
STRENGTH = 1e5
DEFAULT = ContactModel(HystereticLinearSpring(), CoulombSpring(), Type3Rolling(), DRY, VACUUM)


def instance(law_type):
    """A law with its defaults."""
    return law_type(**{f: law_type._field_defaults.get(f, STRENGTH) for f in law_type._fields})


def of_kind(kind):
    """(law, implementation) of every registered law of a kind, by name."""
    return {t.__name__: (instance(t), function) for t, function in KINDS[kind].items()}


def every_law():
    """(kind, law, implementation) of every registered law, by name."""
    return {
        f"{kind}-{name}": (kind, law, function)
        for kind in KINDS
        for name, (law, function) in of_kind(kind).items()
    }


def composed_models():
    """A contact model around every registered law; the other kinds are the paper's."""
    models = {"paper": DEFAULT}
    for kind in KINDS:
        for name, (law, _) in of_kind(kind).items():
            model = DEFAULT._replace(**{kind: law})
            if model != DEFAULT and kind != "field":
                models[name] = model
    models["hertz_mindlin"] = laws.hertz_mindlin_model()
    return models


def pair(rng, restitution=None, friction=0.5):
    """A contact of two bodies of random size and stiffness. A Pair is the same from both sides by its making."""
    r_i, r_j = rng.uniform(0.003, 0.02, 2).tolist()
    m_i, m_j = 2500.0 * 4.0 / 3.0 * math.pi * r_i**3, 2000.0 * 4.0 / 3.0 * math.pi * r_j**3
    youngs_i, youngs_j = rng.uniform(5e6, 5e7, 2).tolist()
    e_star = 1.0 / (0.94 / youngs_i + 0.9 / youngs_j)
    e = rng.uniform(0.2, 1.0) if restitution is None else restitution
    return Pair(
        mass=m_i * m_j / (m_i + m_j),
        radius=r_i * r_j / (r_i + r_j),
        stiffness=2.0 / (1.0 / (youngs_i * r_i) + 1.0 / (youngs_j * r_j)),
        youngs=e_star,
        shear=0.4 * e_star,
        restitution=e,
        unloading=1.0 / (e * e),
        damping_ratio=-math.log(e) / math.hypot(math.log(e), math.pi),
        static=friction,
        dynamic=0.9 * friction,
        rolling=0.3,
    )


def unit(rng):
    v = rng.normal(size=3)
    return v / math.sqrt(v @ v)


def across(n, rng, size):
    """A random vector at right angles to n."""
    v = rng.normal(size=3)
    v -= (v @ n) * n
    return size * rng.uniform(0.1, 1.0) * v / math.sqrt(v @ v)


def vec(a):
    return Vec3(float(a[0]), float(a[1]), float(a[2]))


def contact_time(p):
    """A time that scales an impact of this pair, s."""
    return math.sqrt(p.mass / (p.youngs * p.radius))


def pressed(p, rng):
    """What a normal law may have said of this pair at a random overlap: a valid input for the others."""
    overlap = 0.01 * p.radius * rng.uniform(0.1, 1.0)
    stiffness = p.youngs * p.radius
    return Normal(
        stiffness * overlap, stiffness * overlap, stiffness, 0.1 * math.sqrt(stiffness * p.mass), 1e-3
    )


def arguments(kind, rng):
    """Random valid arguments of a law of a kind, after the law itself."""
    p = pair(rng)
    n = unit(rng)
    dt = 0.02 * contact_time(p)
    normal = pressed(p, rng)
    overlap = 0.01 * p.radius * rng.uniform(0.1, 1.0)
    if kind == "normal":
        elastic = p.youngs * p.radius * overlap * rng.uniform(0.0, 1.0)
        before = overlap * rng.uniform(0.9, 1.1)
        return (p, overlap, rng.normal(0.0, 0.1), elastic, before, 100.0 * dt * rng.random(), dt)
    if kind == "tangential":
        spring = vec(across(n, rng, 1e-5))
        return (p, normal, vec(n), vec(across(n, rng, 0.3)), spring, float(rng.integers(2)), dt)
    if kind == "rolling":
        couple = vec(across(n, rng, 0.3 * p.radius * normal.force))
        return (p, normal, normal.stiffness, vec(n), vec(30.0 * rng.normal(size=3)), couple, dt)
    if kind == "cohesion":
        return (p, overlap)
    return (Body(vec(rng.normal(size=3)), vec(rng.normal(size=3)), vec(rng.normal(size=3)), 0.01, 0.02),)


def numbers(result):
    """All floats of a law's result, flat."""
    if isinstance(result, tuple):
        return [x for part in result for x in numbers(part)]
    return [float(result)]


def generator(seed):
    return np.random.default_rng([42, seed])
