"""Which triangles are near a point: a tree of boxes over triangles sorted along a Morton curve.

A tree rather than a grid, because large and small triangles mix in one mesh: its memory is one box per four
triangles whatever their sizes. It is an implicit heap: node k has the children 2 k and 2 k + 1, node 1 is the
root, and leaf l (node L + l, L a power of two) holds triangles LEAF l to LEAF (l + 1) - 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from demcore.contact.model import Vec3
from demcore.jit import leaf

LEAF = 4
# Boxes are wider by this share of their mesh, against the rounding of the test that leaves them out.
MARGIN = 1e-12

Floats = NDArray[np.float64]


def morton_order(corners: Floats) -> NDArray[np.int64]:
    """Order of triangles (T, 3, 3) by the Morton code of their centroids."""
    centroid = corners.mean(axis=1)
    low = centroid.min(axis=0)
    extent = max(float((centroid.max(axis=0) - low).max()), 1e-300)
    cell = np.minimum((centroid - low) / extent * 2**20, 2**20 - 1).astype(np.int64)
    code = np.zeros(len(corners), np.int64)
    for bit in range(20):
        for c in range(3):
            code |= ((cell[:, c] >> bit) & 1) << (3 * bit + c)
    return np.argsort(code, kind="stable")


def build_tree(corners: Floats) -> Floats:
    """Boxes (2 L, 6) of sorted triangles (T, 3, 3): lowest corner, highest corner; row 0 is not used."""
    count = len(corners)
    leaves = 1
    while leaves * LEAF < count:
        leaves *= 2
    low = np.full((leaves * LEAF, 3), np.inf)
    high = np.full((leaves * LEAF, 3), -np.inf)
    margin = MARGIN * float(np.abs(corners).max())
    low[:count] = corners.min(axis=1) - margin
    high[:count] = corners.max(axis=1) + margin
    box = np.zeros((2 * leaves, 6))
    box[leaves:, :3] = low.reshape(leaves, LEAF, 3).min(axis=1)
    box[leaves:, 3:] = high.reshape(leaves, LEAF, 3).max(axis=1)
    while leaves > 1:
        leaves //= 2
        children = box[2 * leaves : 4 * leaves].reshape(leaves, 2, 6)
        box[leaves : 2 * leaves, :3] = children[:, :, :3].min(axis=1)
        box[leaves : 2 * leaves, 3:] = children[:, :, 3:].max(axis=1)
    return box


@leaf
def is_far(box: Floats, k: int, q: Vec3, reach: float) -> bool:
    """True when no point of box k is within `reach` of q."""
    x = max(box[k, 0] - q.x, 0.0, q.x - box[k, 3])
    y = max(box[k, 1] - q.y, 0.0, q.y - box[k, 4])
    z = max(box[k, 2] - q.z, 0.0, q.z - box[k, 5])
    return not x * x + y * y + z * z <= reach * reach


@leaf
def next_leaf(box: Floats, first: int, leaves: int, k: int, q: Vec3, reach: float) -> int:
    """The first leaf at or after node k, in the order of the curve, that may be within reach; 0 when none.

    Nodes of a mesh begin at row `first`. Start with k = 1, go on with `following(k)`.
    """
    while k > 0:
        if is_far(box, first + k, q, reach):
            k = following(k)
        elif k >= leaves:
            return k
        else:
            k = 2 * k
    return 0


@leaf
def following(k: int) -> int:
    """The node after the subtree of k in the order of the curve; 0 after the last one."""
    while k & 1:
        k >>= 1
    return k + 1 if k > 0 else 0
