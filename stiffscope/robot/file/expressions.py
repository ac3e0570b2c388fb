"""Expressions of a robot file: "= 0.18 + a*cos(th)", arithmetic with named numbers only.

The text is parsed by Python's parser, and only whitelisted nodes are evaluated, so no attribute,
call or import of Python is accessible. Numbers are floats, so powers are fast.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from stiffscope.errors import expecting, require, say_count, suggest

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping

    Operation = Callable[..., Any]

MOST_CHARACTERS = 500
MOST_LEVELS = 100
FUNCTIONS: dict[str, tuple[Operation, int]] = {
    **{
        function.__name__: (function, 1)
        for function in (math.sqrt, math.sin, math.cos, math.tan)
    },
    **{
        function.__name__: (function, 1)
        for function in (math.asin, math.acos, math.atan)
    },
    "atan2": (math.atan2, 2),
}
CONSTANTS = {"pi": math.pi}
Powers = tuple[float, ...]  # of metre, kilogram, second, kelvin and radian
PLAIN: Powers = (0.0, 0.0, 0.0, 0.0, 0.0)
_ANGLE: Powers = (0.0, 0.0, 0.0, 0.0, 1.0)
_FACTORS = (
    10  # below, a whole number is a plain factor; any other may have a unit of its own
)
_OPERATORS: dict[type[ast.AST], Operation] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_WHAT = f"+ - * / ** ( ), {' '.join(FUNCTIONS)} pi, and names of [parameters] or part.parameter"


@dataclass(frozen=True)
class Expression:
    """A parsed expression: its tree and the names in it, "a" or "part.parameter"."""

    text: str
    tree: ast.expr
    names: tuple[str, ...]

    def value(self, values: Mapping[str, float]) -> float:
        """Return its value, SI, given its names' values; ValueError unless finite and real."""
        result = _evaluate(self.tree, self.text, values)
        require(
            math.isfinite(result),
            "",
            "an expression of finite value",
            "one that is too large",
        )
        return result

    def powers(self, known: Mapping[str, Powers | None]) -> Powers | None:
        """What it measures, from what its names do; None if a number without a unit leaves it open.

        Raises ValueError for a sum of unlike quantities, or a sine of what is no angle.
        """
        return _measure(self.tree, self.text, known)


def is_expression(value: Any) -> bool:
    """Return whether a value is an expression: a string that begins with "="."""
    return isinstance(value, str) and value.lstrip().startswith("=")


def refuse_name(name: str) -> None:
    """Raise ValueError if expressions cannot use a parameter's name."""
    require(
        name not in FUNCTIONS and name not in CONSTANTS,
        "",
        "another name",
        f'"{name}", which expressions already have',
    )
    require(
        name.isidentifier() and not keyword.iskeyword(name),
        "",
        "a name that expressions can use (letters, digits, _; no keyword of Python)",
        f'"{name}"',
    )


def normalize(name: str) -> str:
    """Normalize a name as Python's parser does (micro sign and Greek mu are equal)."""
    return unicodedata.normalize("NFKC", name)


def parse(text: str) -> Expression:
    """Parse "= …"; raise ValueError, one line, unless it is arithmetic."""
    body = " ".join(text.strip().removeprefix("=").split())
    require(
        len(body) <= MOST_CHARACTERS,
        "",
        f"an expression of at most {MOST_CHARACTERS} characters",
        len(body),
    )
    shown = f'"= {_cut(body)}"'
    what = 'an expression without units such as "= 0.18 + a*cos(th)"'
    unread = SyntaxError, RecursionError, MemoryError, ValueError
    with expecting("", what, *unread, got=shown):
        tree = ast.parse(body, mode="eval").body
    most = f"an expression of at most {MOST_LEVELS} levels"
    require(_levels(tree) <= MOST_LEVELS, "", most, shown)
    return Expression(body, tree, tuple(dict.fromkeys(_names(tree, body))))


def check_names(expression: Expression, known: Collection[str]) -> None:
    """Raise ValueError if a name is unknown, with the closest match."""
    for name in expression.names:
        if name not in known:
            listed = ", ".join(sorted(known)[:12]) or "(none)"
            what = f"a name of [parameters] or part.parameter ({listed})"
            raise ValueError(
                f'expected {what}, got "{name}"{suggest(name, sorted(known))}'
            )


def _levels(tree: ast.expr) -> int:
    """Return the depth of an expression's tree."""
    level = [tree]
    count = 0
    while level and count <= MOST_LEVELS:
        level = [child for node in level for child in ast.iter_child_nodes(node)]
        count = count + 1
    return count


def _names(node: ast.expr, text: str) -> Iterator[str]:
    """Yield the names in an expression; raise ValueError unless it is arithmetic."""
    if isinstance(node, ast.Name):
        got = f"{node.id} without its argument"
        require(node.id not in FUNCTIONS, "", f"{node.id}(…)", got)
    if isinstance(node, ast.Name | ast.Attribute):
        name = _join_dotted(node, text)
        if name not in CONSTANTS:
            yield name
    elif not (isinstance(node, ast.Constant) and type(node.value) in {int, float}):
        for operand in _operation(node, text)[1]:
            yield from _names(operand, text)


def _evaluate(node: ast.expr, text: str, values: Mapping[str, float]) -> float:
    if isinstance(node, ast.Constant):
        what = "numbers up to 1e308"
        with expecting("", what, OverflowError, got="a larger one"):
            return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name | ast.Attribute):
        name = _join_dotted(node, text)
        return CONSTANTS[name] if name in CONSTANTS else values[name]
    operation, operands = _operation(node, text)
    numbers = [_evaluate(operand, text, values) for operand in operands]
    return _apply(operation, numbers, _piece(node, text))


def _measure(  # noqa: PLR0911 (one for each kind of node)
    node: ast.expr, text: str, known: Mapping[str, Powers | None]
) -> Powers | None:
    if isinstance(node, ast.Constant):
        return PLAIN if isinstance(node.value, int) and node.value < _FACTORS else None
    if isinstance(node, ast.Name | ast.Attribute):
        name = _join_dotted(node, text)
        return PLAIN if name in CONSTANTS else known.get(name)
    operation, operands = _operation(node, text)
    measured = [_measure(operand, text, known) for operand in operands]
    first = measured[0]
    last = measured[-1]
    match node:
        case ast.UnaryOp():
            return first
        case ast.BinOp(op=ast.Add() | ast.Sub()) | ast.Call(func=ast.Name(id="atan2")):
            alike = fits(first, last) or fits(last, first)
            require(alike, "", "quantities of one kind", _piece(node, text))
            alike = first if first != PLAIN else last
            return (
                _ANGLE
                if isinstance(node, ast.Call)
                else None
                if None in measured
                else alike
            )
        case ast.BinOp(op=ast.Pow(), right=power):
            share = None if any(_names(power, text)) else _evaluate(power, text, {})
            return (
                first and tuple(operand * share for operand in first)
                if share is not None
                else None
            )
        case ast.BinOp(op=op):
            sign = operator.add if isinstance(op, ast.Mult) else operator.sub
            return first and last and tuple(map(sign, first, last))
    if operation is math.sqrt:
        return first and tuple(operand / 2.0 for operand in first)
    got = f"{_piece(node, text)} of another quantity"
    require(not any((first or ())[:-1]), "", "an angle or a plain number", got)
    return _ANGLE if operation in {math.asin, math.acos, math.atan} else PLAIN


def fits(powers: Powers | None, wanted: Powers | None) -> bool:
    """Whether a quantity may be one of another kind: unknown ones and plain numbers may be any."""
    if not powers or not wanted or powers == PLAIN:
        return True
    return all(map(math.isclose, powers[:-1], wanted[:-1]))


def _operation(node: ast.expr, text: str) -> tuple[Operation, list[ast.expr]]:
    """Return a node's operation and operands; ValueError unless it is whitelisted."""
    match node:
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)], [operand]
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)], [left, right]
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if (
            name in FUNCTIONS
        ):
            function, count = FUNCTIONS[name]
            require(
                len(args) == count,
                "",
                f"{say_count(count, 'argument')} of {name}",
                len(args),
            )
            return function, args
    hint = (
        "; a power is **"
        if any(isinstance(part, ast.BitXor) for part in ast.walk(node))
        else ""
    )
    raise ValueError(f"expected only {_WHAT}, got {_piece(node, text)}{hint}")


def _join_dotted(node: ast.expr, text: str) -> str:
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value, attr=attribute):
            return f"{_join_dotted(value, text)}.{attribute}"
    raise ValueError(f"expected only {_WHAT}, got {_piece(node, text)}")


def _piece(node: ast.expr, text: str) -> str:
    """Return the source text of a node."""
    return _cut(ast.get_source_segment(text, node) or text)


def _apply(function: Operation, values: list[float], piece: str) -> float:
    """Apply a function to numbers; ValueError, naming the operands, unless finite and real."""
    shown = f"{piece} of {', '.join(f'{value:.6g}' for value in values)}"
    try:
        result = function(*values)
    except (ArithmeticError, ValueError) as error:
        fault = f"{shown}: {error.args[-1]}"
        raise ValueError(
            f"expected an expression of finite real value, got {fault}"
        ) from error
    real = not isinstance(result, complex)
    require(real, "", "an expression of real value", f"{shown}, which has none")
    return result


def _cut(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
