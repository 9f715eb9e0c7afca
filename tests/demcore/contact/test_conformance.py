"""What every registered law must hold, whatever it is: pure scalar functions, no memory before the first touch,
no energy out of nothing, its own limits, the same result in another frame and from the other body."""

from __future__ import annotations

import inspect
import math
import types

import numba
import numpy as np
import pytest

from demcore.contact.coulomb_spring import CoulombSpring
from demcore.contact.hertz import Hertz
from demcore.contact.model import History, Vec3
from demcore.wrench import contact_wrench
from tests.demcore.contact.registered import (
    KINDS,
    arguments,
    composed_models,
    contact_time,
    every_law,
    generator,
    numbers,
    of_kind,
    pair,
    pressed,
    unit,
    vec,
)

LAWS = every_law()
NOTHING = Vec3(0.0, 0.0, 0.0)


def each(kind):
    laws = of_kind(kind)
    return pytest.mark.parametrize(("law", "function"), laws.values(), ids=laws)


def rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def turned(turn, v):
    return vec(turn @ np.array(v))


# Pure scalar functions, which another backend can take as they are


@pytest.mark.parametrize("name", LAWS)
def test_a_law_gives_the_same_with_and_without_compilation_and_twice(name):
    kind, law, function = LAWS[name]
    rng = generator(1)
    for _ in range(50):
        given = arguments(kind, rng)
        compiled, plain = function(law, *given), function.py_func(law, *given)
        assert type(compiled) is type(plain)
        assert numbers(compiled) == pytest.approx(numbers(plain), rel=1e-14, abs=0.0)
        assert numbers(function(law, *given)) == numbers(compiled)
        assert all(math.isfinite(x) for x in numbers(compiled))


def assert_scalar(numba_type):
    if isinstance(numba_type, numba.types.BaseNamedTuple):
        for inner in numba_type.types:
            assert_scalar(inner)
    else:
        assert isinstance(numba_type, numba.types.Float), numba_type


@pytest.mark.parametrize("name", LAWS)
def test_a_law_takes_and_gives_nothing_but_floats_in_named_tuples(name):
    kind, law, function = LAWS[name]
    function(law, *arguments(kind, generator(2)))
    assert function.overloads
    for signature, compiled in function.overloads.items():
        for numba_type in (*signature, compiled.signature.return_type):
            assert_scalar(numba_type)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_reaches_for_nothing_outside_but_mathematics_records_and_other_leaves(name):
    _, _, function = LAWS[name]
    for variable, value in inspect.getclosurevars(function.py_func).globals.items():
        is_record = isinstance(value, type) and issubclass(value, tuple)
        is_leaf = isinstance(value, numba.core.dispatcher.Dispatcher)
        is_mathematics = isinstance(value, types.ModuleType) and value is math
        assert is_record or is_leaf or is_mathematics or isinstance(value, float), variable
    assert not inspect.getclosurevars(function.py_func).nonlocals


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_has_laws_and_each_is_one_file_that_cites_its_source(kind):
    assert KINDS[kind]
    for law_type, function in KINDS[kind].items():
        module = inspect.getmodule(law_type)
        assert module is inspect.getmodule(function.py_func)
        assert module.__doc__
        assert function.py_func.__doc__
    files = [inspect.getmodule(t).__name__ for t in KINDS[kind]]
    assert len(set(files)) == len(files)


@pytest.mark.parametrize("kind", ["normal", "tangential", "rolling", "cohesion"])
def test_only_the_two_laws_that_do_nothing_need_no_source(kind):
    for law_type in KINDS[kind]:
        assert law_type.__name__ == "Dry" or "Source:" in inspect.getmodule(law_type).__doc__


# Normal laws


def closed_path(rng, deepest, waves=4):
    """Overlap from 0 to 0 over [0, 1], pressing and releasing several times in between."""
    t = np.linspace(0.0, 1.0, 20001)
    wobble = sum(rng.normal() * np.sin(2 * math.pi * k * t + rng.uniform(0, 6)) for k in range(1, waves + 1))
    path = np.sin(math.pi * t) * (1.2 + 0.5 * wobble)
    path = np.abs(path)
    return deepest * path / path.max(), t


def normal_work(law, function, p, path, duration):
    """Work that the contact does on the bodies along a path of overlaps, J, and the largest force, N."""
    dt = duration / (len(path) - 1)
    elastic = before = age = work = most = 0.0
    force = 0.0
    for overlap in path[1:]:
        if overlap <= 0.0:
            elastic = before = age = force = 0.0
            continue
        change = overlap - before
        result = function(law, p, overlap, -change / dt, elastic, before, age, dt)
        work -= 0.5 * (force + result.force) * change
        elastic, before, age, force = result.elastic, overlap, result.age, result.force
        most = max(most, force)
    return work, most


@each("normal")
def test_pressing_and_releasing_never_gives_energy(law, function):
    for seed in range(12):
        rng = generator(seed)
        p = pair(rng)
        deepest = 0.02 * p.radius
        path, _ = closed_path(rng, deepest)
        duration = contact_time(p) * rng.uniform(5.0, 100.0)
        work, most = normal_work(law, function, p, path, duration)
        assert work <= 1e-4 * most * deepest


@each("normal")
def test_an_inelastic_contact_loses_energy(law, function):
    rng = generator(3)
    p = pair(rng, restitution=0.5)
    t = np.linspace(0.0, 1.0, 5001)
    deepest = 0.02 * p.radius
    work, most = normal_work(law, function, p, deepest * np.sin(math.pi * t), 4.0 * contact_time(p))
    assert work < -0.1 * most * deepest


@each("normal")
def test_a_contact_that_only_just_touches_has_no_force(law, function):
    rng = generator(4)
    for _ in range(20):
        p = pair(rng)
        deep = function(law, p, 0.01 * p.radius, 0.0, 0.0, 0.0, 0.0, 1e-6)
        touch = function(law, p, 1e-9 * p.radius, 0.0, 0.0, 0.0, 0.0, 1e-6)
        assert deep.force > 0.0
        assert 0.0 <= touch.force < 1e-5 * deep.force
        assert touch.age == pytest.approx(1e-6)


# Tangential and rolling laws


def test_every_kind_of_history_law_is_covered():
    assert set(KINDS) == {"normal", "tangential", "rolling", "cohesion", "field"}


@each("tangential")
def test_friction_obeys_coulomb_in_the_tangent_plane(law, function):
    rng = generator(6)
    capped = 0
    for _ in range(300):
        p, normal, n, v, spring, sliding, dt = arguments("tangential", rng)
        result = function(law, p, normal, n, v, spring, sliding, dt)
        force, limit = np.array(result.force), p.static * normal.force
        assert math.sqrt(force @ force) <= limit * (1.0 + 1e-12)
        assert abs(force @ np.array(n)) <= 1e-12 * limit
        capped += math.sqrt(force @ force) > 0.99 * p.dynamic * normal.force
        for pressing in (0.0, -5.0):
            slack = function(law, p, normal._replace(force=pressing), n, v, spring, sliding, dt)
            assert numbers(slack.force) == [0.0, 0.0, 0.0]
        smooth = function(law, p._replace(static=0.0, dynamic=0.0), normal, n, v, spring, sliding, dt)
        assert numbers(smooth.force) == [0.0, 0.0, 0.0]
    assert 20 < capped < 300


def held_history(result):
    """What a tangential or rolling law gets back at the next step."""
    return result.spring if hasattr(result, "spring") else result


def shear_work(kind, law, function, p, normal, size, steps=4000):
    """Work on the body along a random closed path of slip (or roll) in the tangent plane, at constant load."""
    rng = generator(11)
    n = np.array([0.0, 0.0, 1.0])
    t = np.linspace(0.0, 1.0, steps + 1)
    waves = [
        sum(rng.normal() * np.sin(2 * math.pi * k * t) for k in (1, 2, 3)) * np.sin(math.pi * t)
        for _ in range(2)
    ]
    scale = size / max(np.abs(w).max() for w in waves)
    path = np.column_stack([scale * waves[0], scale * waves[1], np.zeros(steps + 1)])
    dt = 0.02 * contact_time(p)
    memory, sliding, work, before = NOTHING, 0.0, 0.0, np.zeros(3)
    for step in np.diff(path, axis=0):
        rate = vec(step / dt)
        if kind == "tangential":
            result = function(law, p, normal, vec(n), rate, memory, sliding, dt)
            sliding, now = result.sliding, np.array(result.force)
        else:
            result = function(law, p, normal, normal.stiffness, vec(n), rate, memory, dt)
            now = np.array(result)
        memory = held_history(result)
        work += 0.5 * (before + now) @ step
        before = now
    return work


@pytest.mark.parametrize("name", [n for n in LAWS if LAWS[n][0] in ("tangential", "rolling")])
@pytest.mark.parametrize("reach", [0.3, 3.0, 30.0])
def test_a_closed_path_of_slip_or_roll_never_gives_energy(name, reach):
    kind, law, function = LAWS[name]
    for seed in range(5):
        rng = generator(seed)
        p = pair(rng)
        normal = pressed(p, rng)._replace(damping=0.0)
        if kind == "tangential":
            slip = p.static * normal.force / normal.stiffness
            most = p.static * normal.force * slip
        else:
            slip = p.rolling * p.radius * normal.force / (p.radius**2 * normal.stiffness)
            most = p.rolling * p.radius * normal.force * slip
        work = shear_work(kind, law, function, p, normal, reach * slip)
        assert work <= 1e-3 * most
        if reach > 1.0:
            assert work < -0.5 * most, "slip must cost energy"
        else:
            assert abs(work) < 1e-2 * most, "below the limit it is a spring"


@each("tangential")
def test_friction_turns_with_the_frame_and_with_the_body(law, function):
    rng = generator(7)
    for _ in range(50):
        p, normal, n, v, spring, sliding, dt = arguments("tangential", rng)
        base = function(law, p, normal, n, v, spring, sliding, dt)
        turn = rotation(rng)
        other = function(law, p, normal, *(turned(turn, a) for a in (n, v, spring)), sliding, dt)
        scale = p.static * normal.force
        assert np.array(other.force) == pytest.approx(turn @ np.array(base.force), abs=1e-12 * scale)
        assert other.sliding == base.sliding
        minus = (vec(-np.array(a)) for a in (n, v, spring))
        opposite = function(law, p, normal, *minus, sliding, dt)
        assert np.array(opposite.force) == pytest.approx(-np.array(base.force), abs=1e-12 * scale)


@each("rolling")
def test_a_rolling_couple_obeys_its_limit_and_has_no_torsion(law, function):
    rng = generator(8)
    capped = 0
    for _ in range(300):
        p, normal, stiffness, n, spin, couple, dt = arguments("rolling", rng)
        result = np.array(function(law, p, normal, stiffness, n, spin, couple, dt))
        limit = p.rolling * p.radius * normal.force
        assert math.sqrt(result @ result) <= limit * (1.0 + 1e-12)
        assert abs(result @ np.array(n)) <= 1e-12 * limit
        capped += math.sqrt(result @ result) > 0.999 * limit
        slack = function(law, p, normal._replace(force=-1.0), stiffness, n, spin, couple, dt)
        assert numbers(slack) == [0.0, 0.0, 0.0]
        twist = vec(10.0 * np.array(n))
        assert numbers(function(law, p, normal, stiffness, n, twist, NOTHING, dt)) == pytest.approx(
            [0.0, 0.0, 0.0], abs=1e-12 * limit
        )
    assert 20 < capped < 300


@each("rolling")
def test_a_rolling_couple_turns_with_the_frame_and_with_the_body(law, function):
    rng = generator(9)
    for _ in range(50):
        p, normal, stiffness, n, spin, couple, dt = arguments("rolling", rng)
        base = np.array(function(law, p, normal, stiffness, n, spin, couple, dt))
        turn = rotation(rng)
        n2, spin2, couple2 = (turned(turn, a) for a in (n, spin, couple))
        other = np.array(function(law, p, normal, stiffness, n2, spin2, couple2, dt))
        scale = p.rolling * p.radius * normal.force
        assert other == pytest.approx(turn @ base, abs=1e-12 * scale)
        minus = [vec(-np.array(a)) for a in (n, spin, couple)]
        opposite = np.array(function(law, p, normal, stiffness, *minus, dt))
        assert opposite == pytest.approx(-base, abs=1e-12 * scale)


# Cohesion and fields


@each("cohesion")
def test_cohesion_attracts_and_does_not_fall_as_the_contact_deepens(law, function):
    rng = generator(10)
    for _ in range(50):
        p, overlap = arguments("cohesion", rng)
        pull = function(law, p, overlap)
        assert pull >= 0.0
        assert function(law, p, overlap * 1.1) >= pull


@each("field")
def test_a_field_is_finite_on_a_particle_at_rest(law, function):
    body = arguments("field", generator(12))[0]._replace(velocity=NOTHING, spin=NOTHING)
    assert all(math.isfinite(x) for x in numbers(function(law, body)))


# The composition of a model's laws is itself a pure scalar function


MODELS = composed_models()
each_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
NEW = History(0.0, 0.0, 0.0, 0.0, NOTHING, NOTHING)


@each_model
def test_a_whole_contact_is_scalar_and_the_same_without_compilation(model):
    rng = generator(13)
    for _ in range(20):
        p, n = pair(rng), unit(rng)
        overlap, dt = 0.01 * p.radius, 0.02 * contact_time(p)
        v, spin = vec(rng.normal(size=3)), vec(30.0 * rng.normal(size=3))
        given = (model, p, overlap, vec(n), v, spin, NEW, dt)
        compiled, plain = contact_wrench(*given), contact_wrench.py_func(*given)
        assert numbers(compiled) == pytest.approx(numbers(plain), rel=1e-12, abs=1e-15)
    for compiled in contact_wrench.overloads.values():
        for numba_type in (*compiled.signature.args, compiled.signature.return_type):
            assert_scalar(numba_type)


CONSTANT_SHEAR = {
    name: m
    for name, m in MODELS.items()
    if isinstance(m.tangential, CoulombSpring) and not isinstance(m.normal, Hertz)
}


@pytest.mark.parametrize("name", CONSTANT_SHEAR)
def test_pressing_and_shearing_together_never_gives_energy(name):
    # Random closed paths of overlap and slip at once; the tangential stiffness must not depend on the overlap,
    # so Mindlin's spring and K_t of the Hertz law are not asked (Elata and Berryman 1996).
    model = CONSTANT_SHEAR[name]
    for seed in range(6):
        rng = generator(seed)
        p = pair(rng)
        deepest = 0.02 * p.radius
        press, t = closed_path(rng, deepest)
        slip = deepest * sum(rng.normal() * np.sin(2 * math.pi * k * t) for k in (1, 2, 3))
        dt = contact_time(p) * rng.uniform(5.0, 60.0) / len(t)
        h, before, work, most = NEW, np.zeros(3), 0.0, 0.0
        for k in range(1, len(t)):
            if press[k] <= 0.0:
                h, before = NEW, np.zeros(3)
                continue
            way = np.array([slip[k] - slip[k - 1], 0.0, press[k - 1] - press[k]])
            result = contact_wrench(model, p, press[k], Vec3(0.0, 0.0, 1.0), vec(way / dt), NOTHING, h, dt)
            now, h = np.array(result.force), result.history
            work += 0.5 * (before + now) @ way
            before, most = now, max(most, abs(now[2]))
        assert work <= 1e-4 * most * deepest
