"""Which of the triangles that a sphere overlaps are contacts, and whose history each contact goes on with.

Notation: d distance of the centre to a triangle, n unit normal from its nearest point to the centre, in the
world; hit: a triangle with d < r; feature: nearest point on the face, an edge or a vertex.

A surface in many triangles must feel as one. Seen from the sphere's centre a hit is the point -d n, and what a
flat or gently curved patch adds to its deepest hit lies near that one: so the deepest hit is a contact, and
every other hit falls away that
  - lies on or behind the plane through the contact across its normal (d' n'.n >= d): what an edge or vertex of a
    face that touches does, a coplanar neighbour, the far side of a T-junction or of a convex edge. Such a hit is
    in the cap that the contact cuts off, so it is never the deeper one;
  - has a normal within PATCH_ANGLE of the contact's: the same gently curved patch.
What is left is another place (the other wall of a corner, the far side of a tube), and the rule goes on with it.
A face comes before an edge and an edge before a vertex where they are as deep. The rule needs no topology, so a
soup of triangles, T-junctions and edges shared by three faces are no special cases.

The contact point is on the sphere, so a contact is known again by its normal: when the deepest triangle changes,
the history moves to the new one with the normal that is nearest, and turns with it.
"""

from __future__ import annotations

import math

from demcore.contact.model import Vec3
from demcore.geometry.motion import rotate, to_body, turn_about, turn_to_world, vector_at
from demcore.geometry.surfaces import triangle_distance
from demcore.geometry.wall_rows import Walls
from demcore.jit import leaf
from demcore.wall_list import FEATURE, STATE, WallList, forget_slot
from demcore.wrench import HISTORY_WIDTH, OVERLAP

# Choice: below this angle two faces are one curved patch, above it a corner with two contacts. A tube of 12
# facets is a patch, the edges of a box are not.
PATCH_ANGLE_DEG = 35.0
COS_PATCH = math.cos(math.radians(PATCH_ANGLE_DEG))
# A history may follow its contact a little farther: both faces of a patch may touch while it changes over.
COS_FOLLOW = math.cos(math.radians(PATCH_ANGLE_DEG + 5.0))
# Share of the radius within which two depths are the same.
SAME_DEPTH = 1e-10

APART, OPEN, ACCEPTED, DROPPED = 0.0, 1.0, 2.0, 3.0


@leaf
def hit_normal(near: WallList, k: int) -> Vec3:
    """Normal of slot k, in the world."""
    return vector_at(near.hit, k, 1)


@leaf
def measure_hits(
    near: WallList, walls: Walls, begin: int, end: int, x: float, y: float, z: float, r: float, away: float
) -> bool:
    """Distance, normal and feature of the slots begin to end - 1, all of one mesh, but for those that a particle
    cannot have met whose way from home has the square `away`; True with any hit."""
    w = near.wall[begin]
    q = to_body(walls.pose, w, x, y, z)
    any_hit = False
    for k in range(begin, end):
        if away < near.clear[k]:
            near.hit[k, STATE] = APART
            continue
        d, n, feature = triangle_distance(walls.triangle, walls.first_triangle[w] + near.triangle[k], q)
        world = turn_to_world(walls.pose, w, n)
        near.hit[k, 0] = d
        near.hit[k, 1], near.hit[k, 2], near.hit[k, 3] = world.x, world.y, world.z
        near.hit[k, FEATURE] = feature
        near.hit[k, STATE] = OPEN if d < r else APART
        any_hit = any_hit or d < r
    return any_hit


@leaf
def comes_before(near: WallList, a: int, b: int, r: float) -> bool:
    """True when hit a is the one to keep of a and b: deeper; or as deep and face before edge before vertex; or
    as deep and the one that was in contact before."""
    gap = near.hit[b, 0] - near.hit[a, 0]
    if abs(gap) > SAME_DEPTH * r:
        return bool(gap > 0.0)
    if near.hit[a, FEATURE] != near.hit[b, FEATURE]:
        return bool(near.hit[a, FEATURE] < near.hit[b, FEATURE])
    return bool(near.history[a, OVERLAP] != 0.0 and near.history[b, OVERLAP] == 0.0)


@leaf
def choose_contacts(near: WallList, begin: int, end: int, r: float) -> None:
    """Mark the hits of one mesh ACCEPTED or DROPPED, as the module says."""
    while True:
        best = -1
        for k in range(begin, end):
            if near.hit[k, STATE] == OPEN and (best < 0 or comes_before(near, k, best, r)):
                best = k
        if best < 0:
            return
        near.hit[best, STATE] = ACCEPTED
        d, n = near.hit[best, 0], hit_normal(near, best)
        for k in range(begin, end):
            if near.hit[k, STATE] == OPEN:
                m = hit_normal(near, k)
                cosine = n.x * m.x + n.y * m.y + n.z * m.z
                if cosine >= COS_PATCH or near.hit[k, 0] * cosine >= d - SAME_DEPTH * r:
                    near.hit[k, STATE] = DROPPED


@leaf
def move_history(near: WallList, a: int, b: int) -> None:
    """Slot b goes on with the contact of slot a; spring and couple turn as the normal did, by the shortest way."""
    m, n = vector_at(near.normal, a, 0), hit_normal(near, b)
    axis = Vec3(m.y * n.z - m.z * n.y, m.z * n.x - m.x * n.z, m.x * n.y - m.y * n.x)
    sine = math.sqrt(axis.x * axis.x + axis.y * axis.y + axis.z * axis.z)
    turn = turn_about(axis.x, axis.y, axis.z, math.atan2(sine, m.x * n.x + m.y * n.y + m.z * n.z))
    for c in range(HISTORY_WIDTH):
        near.history[b, c] = near.history[a, c]
    for c in (4, 7):
        v = rotate(turn, vector_at(near.history, a, c))
        near.history[b, c], near.history[b, c + 1], near.history[b, c + 2] = v.x, v.y, v.z
    near.normal[b, 0], near.normal[b, 1], near.normal[b, 2] = m.x, m.y, m.z
    forget_slot(near, a)


@leaf
def carry_histories(near: WallList, begin: int, end: int, r: float) -> None:
    """Give each new contact of one mesh the history of a slot that has just lost its own, where one fits.

    One that has turned round fits too when both are close to the centre: it went through the surface, and the
    force loop, which compares the normals, must see that.
    """
    for k in range(begin, end):
        if near.hit[k, STATE] != ACCEPTED or near.history[k, OVERLAP] != 0.0:
            continue
        n = hit_normal(near, k)
        best, closest = -1, COS_FOLLOW
        for o in range(begin, end):
            if near.history[o, OVERLAP] == 0.0 or near.hit[o, STATE] == ACCEPTED:
                continue
            m = vector_at(near.normal, o, 0)
            cosine = n.x * m.x + n.y * m.y + n.z * m.z
            if near.hit[k, 0] + r - near.history[o, OVERLAP] <= r:
                cosine = abs(cosine)
            if cosine >= closest:
                best, closest = o, cosine
        if best >= 0:
            move_history(near, best, k)
