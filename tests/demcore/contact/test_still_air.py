"""Drag of still air through the integrator, against terminal speeds and decays known by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.contact.model import Body, Vec3
from demcore.contact.still_air import StillAir, still_air
from demcore.contact.vacuum import Vacuum, vacuum
from demcore.geometry.wall_arrays import wall_arrays
from demcore.particles import spheres
from demcore.simulation import Simulation

AIR = StillAir()
OIL = StillAir(density=900.0, viscosity=1.0)


def falling(
    radius, density, field, dt, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), gravity=-9.81, threaded=False
):
    return Simulation(
        spheres(
            np.array([[0.0, 0.0, 0.0]]),
            np.array([radius]),
            density,
            velocity=np.array([velocity]),
            spin=np.array([spin]),
        ),
        wall_arrays([]),
        paper_model(field=field),
        uniform_table(Stiffness(1e7, 0.25), Interaction(0.5, 0.5, 0.5, 0.1)),
        dt,
        gravity=np.array([0.0, 0.0, gravity]),
        threaded=threaded,
    )


@pytest.mark.parametrize("threaded", [False, True])
def test_a_small_bead_in_oil_falls_with_stokes_speed(threaded):
    # v = 2 r^2 rho g / (9 eta), no buoyancy; Re = .01
    r, rho = 0.001, 2500.0
    s = falling(r, rho, OIL, 1e-5, threaded=threaded)
    s.advance(2000)
    stokes = 2.0 * r * r * rho * 9.81 / (9.0 * OIL.viscosity)
    assert -s.particles.state[0, 6] == pytest.approx(stokes, rel=0.02)


def test_a_large_sphere_in_air_falls_with_newtons_speed():
    # m g = .22 pi rho r^2 v^2, 35 m/s; from below it comes near by exp(-2 g t / v), to 2e-4 of the gap in 15 s
    r, rho = 0.05, 500.0
    s = falling(r, rho, AIR, 5e-4, velocity=(0.0, 0.0, -30.0))
    s.advance(30_000)
    mass = rho * 4.0 / 3.0 * math.pi * r**3
    newton = math.sqrt(mass * 9.81 / (0.22 * math.pi * AIR.density * r * r))
    assert -s.particles.state[0, 6] == pytest.approx(newton, rel=1e-3)


def test_a_spin_decays_with_its_time():
    # I w' = -8 pi eta r^3 w: w = w0 exp(-15 eta t / (rho r^2))
    r, rho = 0.002, 2500.0
    s = falling(r, rho, OIL, 1e-6, spin=(3.0, -4.0, 12.0), gravity=0.0)
    s.advance(500)
    expected = math.exp(-15.0 * OIL.viscosity * s.time / (rho * r * r))
    assert s.particles.state[0, 8:11] == pytest.approx(expected * np.array([3.0, -4.0, 12.0]), rel=2e-3)


def test_schiller_and_naumanns_coefficient():
    # C = 24/Re (1 + .15 Re^.687): 4.15 at Re = 10, 1.09 at 100, .438 at 1000 (their table, 2 %)
    for reynolds, coefficient in ((10.0, 4.15), (100.0, 1.09), (1000.0, 0.438), (20_000.0, 0.44)):
        r = 0.01
        speed = reynolds * AIR.viscosity / (2.0 * r * AIR.density)
        body = Body(Vec3(0.0, 0.0, 0.0), Vec3(0.0, speed, 0.0), Vec3(0.0, 0.0, 0.0), r, 1.0)
        force = still_air(AIR, body).force
        got = -force.y / (0.5 * AIR.density * math.pi * r * r * speed * speed)
        assert got == pytest.approx(coefficient, rel=0.02)
        assert force.x == force.z == 0.0


def test_drag_takes_energy_whatever_the_direction():
    rng = np.random.default_rng(1)
    for _ in range(100):
        v, w = (10.0 ** rng.uniform(-6, 2) * rng.normal(size=3) for _ in range(2))
        push = still_air(
            AIR, Body(Vec3(1.0, 2.0, 3.0), Vec3(*map(float, v)), Vec3(*map(float, w)), 0.01, 0.1)
        )
        assert np.array(push.force) @ v < 0.0
        assert np.array(push.torque) @ w < 0.0
        assert np.array(push.force) == pytest.approx(
            -np.sqrt((np.array(push.force) @ push.force) / (v @ v)) * v
        )


def test_adding_what_a_vacuum_does_changes_no_bit():
    body = Body(Vec3(0.0, 0.0, 0.0), Vec3(1.0, 2.0, 3.0), Vec3(0.0, 0.0, 0.0), 0.01, 1.0)
    push = vacuum(Vacuum(), body)
    for number in (0.0, -0.0, 1.5, -5e-324, math.inf):
        for nothing in (*push.force, *push.torque):
            assert (number + nothing).hex() == number.hex()
