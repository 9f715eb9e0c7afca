"""Charges that do not wait for each other: one by one, or on several processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

# Calls a function with each of some arguments: pairs of the call's index and what came out, as each ends.
Spread = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterator[tuple[int, Any]]]


def one_by_one(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
    """In this process, in order."""
    return ((k, function(*call)) for k, call in enumerate(calls))


def on_processes(count: int) -> Spread:
    """On `count` processes of their own, in the order in which they end; one is this process."""
    if count == 1:
        return one_by_one

    def spread(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        # Not forked: compiled kernels and their threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(count, max(1, len(calls))), mp_context=context) as pool:
            ends = {pool.submit(function, *call): k for k, call in enumerate(calls)}
            for end in as_completed(ends):
                yield ends[end], end.result()

    return spread
