"""Causes that the library does not have: misfit that sits in a block, modelled as a Gaussian process (rule 6).

Notation (a block of n cells; K kinds of blocks)
    d       sd of each cell's measured mean                                              (N,)
    x       features of conditions: ln mass, moisture, drop height, belt speed, scaled   (C, 4)
    B       square root of the block's covariance in units of d                          (N, n)
    log BF  of r ~ N(0, V + t^2 B B') against N(0, V), averaged over t in SIZES

Blocks: one summary over its conditions (40 % common, 40 % smooth in x, 20 % free), everything in one condition
(free), and each summary shifted in common over one test, one material or the wet conditions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.data_set.records import Condition
from worker.diagnosis.evidence import Whitened
from worker.diagnosis.measured import Frame
from worker.diagnosis.simulator import FloatArray

SIZES = (1.5, 4.0)
_SHARES = (0.4, 0.4, 0.2)
_LEAST_CELLS = 2


@dataclass(frozen=True)
class Block:
    """`kind` is summary, condition, test, material or wet; `name` which one. B (N, n)."""

    kind: str
    name: str
    B: FloatArray

    @property
    def label(self) -> str:
        return f"{self.kind}:{self.name}"


def blocks_of(frame: Frame) -> tuple[Block, ...]:
    """All blocks of a frame."""
    tests = np.array([frame.conditions[c].test for c in frame.condition])
    names = np.array([frame.summary(i) for i in range(frame.size)])
    condition = np.array(frame.condition)
    smooth = _smooth(frame.conditions)
    found = []
    for test, name in dict.fromkeys(zip(tests.tolist(), names.tolist(), strict=True)):
        cells = np.flatnonzero((tests == test) & (names == name))
        if len(cells) >= _LEAST_CELLS:
            own = condition[cells]
            mixed = _SHARES[0] + _SHARES[1] * smooth[np.ix_(own, own)] + _SHARES[2] * np.eye(len(cells))
            found.append(
                Block("summary", f"{test}.{name}", _placed(frame.size, cells, np.linalg.cholesky(mixed)))
            )
    for k, c in enumerate(frame.conditions):
        cells = np.flatnonzero(condition == k)
        if len(cells) >= _LEAST_CELLS:
            found.append(Block("condition", c.condition, _placed(frame.size, cells, np.eye(len(cells)))))
    seen: set[bytes] = set()
    for kind, name, chosen in _groups(frame, tests):
        cells = np.flatnonzero(chosen)
        if len(cells) >= _LEAST_CELLS and chosen.tobytes() not in seen:
            seen.add(chosen.tobytes())
            labels = [f"{t}.{n}" for t, n in zip(tests[cells], names[cells], strict=True)]
            shared = np.array(
                [[label == one for one in dict.fromkeys(labels)] for label in labels], dtype=float
            )
            found.append(Block(kind, name, _placed(frame.size, cells, shared)))
    return tuple(found)


def _groups(frame: Frame, tests: NDArray[np.str_]) -> list[tuple[str, str, NDArray[np.bool_]]]:
    """Kind, name and cells (N,) of groups of conditions."""
    materials = np.array([frame.conditions[c].material for c in frame.condition])
    wet = np.array([frame.conditions[c].moisture_percent > 0.0 for c in frame.condition])
    return [
        *(("test", test, tests == test) for test in dict.fromkeys(tests.tolist())),
        *(("material", m, materials == m) for m in dict.fromkeys(materials.tolist())),
        ("wet", "wet", wet),
    ]


def _smooth(conditions: tuple[Condition, ...]) -> FloatArray:
    """Squared-exponential correlation of conditions (C, C) over their scaled features."""
    x = np.array(
        [[np.log(c.mass_kg), c.moisture_percent, c.drop_height_m, c.belt_speed_m_s] for c in conditions]
    )
    spread = np.std(x, axis=0)
    x = (x - np.mean(x, axis=0)) / np.where(spread > 0.0, spread, 1.0)
    square = np.sum((x[:, None, :] - x[None, :, :]) ** 2, axis=2)
    return np.asarray(np.exp(-0.5 * square))


def _placed(size: int, cells: NDArray[np.intp], root: FloatArray) -> FloatArray:
    B = np.zeros((size, root.shape[1]))
    B[cells] = root
    return B


def log_bayes(blocks: tuple[Block, ...], d: FloatArray, white: Whitened) -> FloatArray:
    """Of each block (U,) with cell sds d (N,), by the determinant lemma: no matrix larger than a block."""
    inverse = np.linalg.inv(white.L) * d
    by_size: dict[int, list[int]] = {}
    for k, block in enumerate(blocks):
        by_size.setdefault(block.B.shape[1], []).append(k)
    found = np.empty(len(blocks))
    for places in by_size.values():
        Z = inverse @ np.stack([blocks[k].B for k in places])
        values, vectors = np.linalg.eigh(np.swapaxes(Z, 1, 2) @ Z)
        values = np.maximum(values, 0.0)
        square = np.einsum("bij,bi->bj", vectors, np.einsum("bni,n->bi", Z, white.r)) ** 2
        each = [
            0.5 * np.sum(t**2 * square / (1.0 + t**2 * values) - np.log1p(t**2 * values), axis=1)
            for t in SIZES
        ]
        found[places] = np.logaddexp.reduce(each, axis=0) - np.log(len(SIZES))
    return found
