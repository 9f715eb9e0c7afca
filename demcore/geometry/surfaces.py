"""Where a point is nearest to a surface: exact distances in the wall's own frame.

Notation: q point in the body's frame; d distance, m; n unit normal from the surface to the point.
A body of revolution about z is the segment of its profile in the half plane (rho, h) with rho, h the distance
to the axis and the height: it starts at (rho_a, 0) and runs `length` along the unit vector (t_rho, t_h). The
nearest point of the body lies in the half plane of q, because every other one is farther at the same profile.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import Vec3
from demcore.jit import leaf

FACE, EDGE, VERTEX = 0, 1, 2


@leaf
def plane_distance(q: Vec3) -> tuple[float, Vec3]:
    """Half space below z = 0; the distance is negative inside it."""
    return q.z, Vec3(0.0, 0.0, 1.0)


@leaf
def revolution_distance(rho_a: float, t_rho: float, t_h: float, length: float, q: Vec3) -> tuple[float, Vec3]:
    """Distance to a body of revolution. On the axis of a tube every direction is as near: x is taken."""
    rho = math.sqrt(q.x * q.x + q.y * q.y)
    x, y = (q.x / rho, q.y / rho) if rho > 0.0 else (1.0, 0.0)
    along = (rho - rho_a) * t_rho + q.z * t_h
    if 0.0 <= along <= length:
        # Beside the segment: its own normal, free of cancellation.
        across = q.z * t_rho - (rho - rho_a) * t_h
        side = 1.0 if across >= 0.0 else -1.0
        return abs(across), Vec3(-side * t_h * x, -side * t_h * y, side * t_rho)
    end = 0.0 if along < 0.0 else length
    away, up = rho - rho_a - end * t_rho, q.z - end * t_h
    d = math.sqrt(away * away + up * up)
    if d == 0.0:
        return 0.0, Vec3(-t_h * x, -t_h * y, t_rho)
    return d, Vec3(away * x / d, away * y / d, up / d)


@leaf
def nearest_on_edge(a: Vec3, b: Vec3, q: Vec3) -> tuple[float, float, float, float, int]:
    """From the nearest point of edge a-b to q: squared distance, vector, and EDGE or VERTEX."""
    ex, ey, ez = b.x - a.x, b.y - a.y, b.z - a.z
    x, y, z = q.x - a.x, q.y - a.y, q.z - a.z
    share = (x * ex + y * ey + z * ez) / (ex * ex + ey * ey + ez * ez)
    feature = EDGE
    if share >= 1.0:
        x, y, z = q.x - b.x, q.y - b.y, q.z - b.z
        feature = VERTEX
    elif share > 0.0:
        x, y, z = x - share * ex, y - share * ey, z - share * ez
    else:
        feature = VERTEX
    return x * x + y * y + z * z, x, y, z, feature


@leaf
def is_inside_edge(a: Vec3, b: Vec3, n: Vec3, q: Vec3) -> bool:
    """True where q is on the triangle's side of its edge a-b: (q - a) . (n x (b - a)) >= 0."""
    ex, ey, ez = b.x - a.x, b.y - a.y, b.z - a.z
    return (
        (q.x - a.x) * (n.y * ez - n.z * ey)
        + (q.y - a.y) * (n.z * ex - n.x * ez)
        + (q.z - a.z) * (n.x * ey - n.y * ex)
    ) >= 0.0


@leaf
def triangle_distance(triangles: NDArray[np.float64], t: int, q: Vec3) -> tuple[float, Vec3, int]:
    """Distance to triangle t of (T, 12) rows (corners, unit normal), the normal towards q, and the feature.

    Inside the prism over the triangle the nearest point is the foot on its plane; outside it is on the nearest
    of the three edges. No barycentric quotient is formed, so slivers are as exact as the rest.
    """
    a = Vec3(triangles[t, 0], triangles[t, 1], triangles[t, 2])
    b = Vec3(triangles[t, 3], triangles[t, 4], triangles[t, 5])
    c = Vec3(triangles[t, 6], triangles[t, 7], triangles[t, 8])
    n = Vec3(triangles[t, 9], triangles[t, 10], triangles[t, 11])
    if is_inside_edge(a, b, n, q) and is_inside_edge(b, c, n, q) and is_inside_edge(c, a, n, q):
        height = (q.x - a.x) * n.x + (q.y - a.y) * n.y + (q.z - a.z) * n.z
        side = 1.0 if height >= 0.0 else -1.0
        return abs(height), Vec3(side * n.x, side * n.y, side * n.z), FACE
    best, x, y, z, feature = nearest_on_edge(a, b, q)
    other, ox, oy, oz, kind = nearest_on_edge(b, c, q)
    if other < best:
        best, x, y, z, feature = other, ox, oy, oz, kind
    other, ox, oy, oz, kind = nearest_on_edge(c, a, q)
    if other < best:
        best, x, y, z, feature = other, ox, oy, oz, kind
    d = math.sqrt(best)
    if d == 0.0:
        return 0.0, n, feature
    return d, Vec3(x / d, y / d, z / d), feature
