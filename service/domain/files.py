"""Kinds of files that runs leave."""

from __future__ import annotations

# The large ones: particles and time series. Retention leaves pictures and reports unless they are named.
LARGE_KINDS = ("vtkhdf", "result", "spheres", "walls")
