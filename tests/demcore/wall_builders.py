"""One sphere among walls, and meshes with known shapes."""

from __future__ import annotations

import math

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import paper_model
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.wall_arrays import wall_arrays
from demcore.particles import spheres
from demcore.simulation import Simulation
from demcore.time_step import time_step

YOUNGS, DENSITY, G, RADIUS = 1e7, 2500.0, 9.81, 0.02
CONTACT = Interaction(0.5, 0.5, 0.45, 0.1)


def single(
    walls,
    position,
    velocity=(0.0, 0.0, 0.0),
    spin=(0.0, 0.0, 0.0),
    contact=CONTACT,
    gravity=(0.0, 0.0, -G),
    radius=RADIUS,
    threaded=False,
    model=None,
):
    """Spheres of one radius; one position, velocity and spin, or a list of each."""
    position = np.atleast_2d(np.array(position, float))
    count = len(position)
    velocity, spin = (np.broadcast_to(np.array(v, float), (count, 3)) for v in (velocity, spin))
    bed = spheres(position, np.full(count, radius), DENSITY, velocity=velocity, spin=spin)
    return Simulation(
        bed,
        wall_arrays(walls),
        model or paper_model(),
        uniform_table(Stiffness(YOUNGS, 0.25), contact),
        time_step(2.0 * radius, DENSITY, YOUNGS, contact.restitution, "paper"),
        gravity=np.array(gravity, float),
        threaded=threaded,
        wall_names=tuple(w.label for w in walls),
    )


def resting_overlap(radius=RADIUS, g=G):
    """m g / K_l with K_l = E radius: the wall's and the sphere's E d in series."""
    return DENSITY * 4.0 / 3.0 * math.pi * radius**3 * g / (YOUNGS * radius)


def plate_mesh(size=1.0, cells=10, jitter=0.0, seed=0):
    """A square plate at z = 0 of 2 cells^2 triangles; inner vertices moved in the plane by a share of a cell."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-size / 2, size / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    inner = (np.abs(points[:, :2]) < size / 2 - 1e-9).all(axis=1)
    points[inner, :2] += rng.uniform(-jitter, jitter, (inner.sum(), 2)) * size / cells
    k = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = k, k + cells + 1, k + cells + 2, k + 1
    return TriangleMesh(points, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def tube_mesh(radius, length, segments, end_radius=None):
    """An open tube (or frustum) about z with its corners on the circle."""
    angle = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(segments)])
    end = radius if end_radius is None else end_radius
    points = np.concatenate([ring * [radius, radius, 1], ring * [end, end, 1] + [0, 0, length]])
    k = np.arange(segments)
    n = (k + 1) % segments
    faces = np.concatenate(
        [np.column_stack([k, n, n + segments]), np.column_stack([k, n + segments, k + segments])]
    )
    return TriangleMesh(points, faces)


def joined(*meshes):
    """Several meshes as one, vertices not shared."""
    points, faces, total = [], [], 0
    for mesh in meshes:
        points.append(mesh.vertices)
        faces.append(mesh.faces + total)
        total += len(mesh.vertices)
    return TriangleMesh(np.concatenate(points), np.concatenate(faces))


def moved(mesh, rotation, shift):
    """The mesh turned by a matrix and shifted."""
    return TriangleMesh(mesh.vertices @ np.array(rotation, float).T + shift, mesh.faces)


def touching(simulation):
    """How many wall contacts there are now."""
    return int((simulation.near_walls.history[:, 1] != 0.0).sum())
