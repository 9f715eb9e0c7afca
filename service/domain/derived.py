"""Derived parameters: expressions of other parameters, such as `0.9 * particle_particle_static_friction`.

Only numbers, names, `+ - * / **`, brackets, `min` and `max`: the text is parsed by Python's own grammar, and
every node that is not of these is refused before anything is computed.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from graphlib import CycleError, TopologicalSorter

from service.domain.errors import InvalidValue

LONGEST = 200

_BINARY: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: Mapping[type[ast.unaryop], Callable[[float], float]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_FUNCTIONS: Mapping[str, Callable[..., float]] = {"min": min, "max": max}
_ALLOWED = "a sum, product, quotient or power of numbers and parameters, min(...) or max(...)"


def names_in(field: str, text: str) -> frozenset[str]:
    """The parameters that an expression reads. Raises InvalidValue where it is more than arithmetic."""
    names: set[str] = set()
    _collect(field, text, _parse(field, text), names)
    return frozenset(names)


def in_order(expressions: Mapping[str, str]) -> tuple[str, ...]:
    """The derived parameters so that each comes after those it reads. Raises InvalidValue for a cycle."""
    graph = {
        name: names_in(f"derived.{name}", text) & expressions.keys() for name, text in expressions.items()
    }
    try:
        return tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        cycle = " -> ".join(error.args[1])
        raise InvalidValue("derived", cycle, "expressions that do not depend on themselves") from None


def evaluate(field: str, text: str, values: Mapping[str, float]) -> float:
    """The number that an expression gives. Raises InvalidValue where it is none (a division by 0, say)."""
    try:
        result = _compute(_parse(field, text), values)
    except (ArithmeticError, ValueError) as error:
        raise InvalidValue(field, text, f"an expression with a value: {error}") from None
    if isinstance(result, complex) or not math.isfinite(result):
        raise InvalidValue(field, text, "an expression with a finite value")
    return result


def _parse(field: str, text: str) -> ast.expr:
    if not isinstance(text, str) or len(text) > LONGEST:
        raise InvalidValue(field, text, f"an expression of at most {LONGEST} characters")
    try:
        return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InvalidValue(field, text, _ALLOWED) from None


def _collect(field: str, text: str, node: ast.expr, names: set[str]) -> None:
    match node:
        case ast.Constant(value=value) if isinstance(value, int | float) and not isinstance(value, bool):
            return
        case ast.Name(id=name):
            names.add(name)
            return
        case ast.UnaryOp(op=sign, operand=inner) if type(sign) in _UNARY:
            parts = [inner]
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _BINARY:
            parts = [left, right]
        case ast.Call(func=ast.Name(id=name), args=parts, keywords=[]) if name in _FUNCTIONS and parts:
            pass
        case _:
            raise InvalidValue(field, text, _ALLOWED)
    for part in parts:
        _collect(field, text, part, names)


def _compute(node: ast.expr, values: Mapping[str, float]) -> float:
    # Everything is a float from the start: 9 ** 9 ** 9 then overflows instead of filling the memory.
    match node:
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name):
            return values[name]
        case ast.UnaryOp(op=sign, operand=inner):
            return _UNARY[type(sign)](_compute(inner, values))
        case ast.BinOp(left=left, op=operation, right=right):
            return _BINARY[type(operation)](_compute(left, values), _compute(right, values))
        case ast.Call(func=ast.Name(id=name), args=[only]) if name in _FUNCTIONS:
            return _compute(only, values)
        case ast.Call(func=ast.Name(id=name), args=parts):
            return _FUNCTIONS[name](*(_compute(part, values) for part in parts))
    raise TypeError(f"{ast.dump(node)} was not refused by names_in")
