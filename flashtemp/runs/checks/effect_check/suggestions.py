"""Messages for a law that fails: its line, and what to write there instead."""

from __future__ import annotations

import ast
import traceback
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

HOLD_REMEDY = "limit what falls to zero: max(now.speed, 1e-4), or where(real(p) > floor, p, floor)"
LIMIT_REMEDY = "use where(real(x) > bound, x, bound)"
STEP_REMEDY = "a step has no slope: leave it out, or use a smooth one, 0.5*(1 + tanh(x/width))"
ALLOWED_OPERATIONS = "write it with + - * / **, exp, tanh, where, Curve and Surface"
NO_DERIVATIVE = {  # functions without a complex derivative, and what to use instead
    "abs": "use sqrt(x*x + tiny) or where(real(x) > 0, x, -x)",
    "sign": "use where(real(x) > 0, 1.0, -1.0) or tanh(x/width)",
    "interp": "use Curve(xs, ys)(x) of flashtemp.physics",
    "hypot": "use sqrt(x*x + y*y)",
    "arctan2": "use arctan(y/x)",
    "max": LIMIT_REMEDY,
    "min": "use where(real(x) < bound, x, bound)",
    "clip": LIMIT_REMEDY + " on either side",
    "floor": STEP_REMEDY,
    "heaviside": STEP_REMEDY,
    "cbrt": "use x**(1/3), limited to values above zero",
    "real": "keep x itself; use real(x) in the condition of where only",
    "float": "leave float() out: laws get arrays",
    "norm": "use sqrt(x*x + y*y)",
}
SYNONYMS = {
    "fabs": "abs", "absolute": "abs", "maximum": "max", "fmax": "max", "minimum": "min", "fmin": "min",
    "amax": "max", "amin": "min", "ceil": "floor", "round": "floor", "rint": "floor", "trunc": "floor",
    "around": "floor", "copysign": "sign", "angle": "arctan2", "atan2": "arctan2", "int": "float", "float64": "float",
    "asfarray": "float", "floor_divide": "floor", "digitize": "floor", "searchsorted": "interp",
}  # fmt: skip


def locate_law(file: Path, law: Callable) -> str:
    """File and first line of a law."""
    while isinstance(law, partial):
        law = law.func
    code = getattr(law, "__code__", None)
    return f"{file}:{code.co_firstlineno}" if code else str(file)


def first_fault_per_line(faults: Iterable[str]) -> list[str]:
    """The first error of every line of a file.

    >>> first_fault_per_line(["a.py:3: falls", "a.py:3: falls far", "a.py:4: falls"])
    ['a.py:3: falls', 'a.py:4: falls']
    """
    first: dict[str, str] = {}
    for fault in faults:
        first.setdefault(fault.split(": ", 1)[0], fault)
    return list(first.values())


def explain_slope(file: Path, law: Callable, contribution: str, variable: str) -> str:
    """The message for a law whose derivative by complex step differs from finite differences."""
    found = [f"{file}:{line}: {what}" for line, what in dict.fromkeys(find_suspect_calls(file, law))]
    if found:
        return "; ".join(found[:2])
    at = locate_law(file, law)
    return f"{at}: {contribution} loses its derivative by {variable} in a complex step; {ALLOWED_OPERATIONS}"


def explain_exception(file: Path, fault: Exception, where: str = "") -> str:
    """The message for an exception in a law: its line and the remedy; `where` describes its arguments."""
    frames = traceback.extract_tb(fault.__traceback__)
    lines = [f.lineno for f in frames if Path(f.filename) == file]
    message = f"{type(fault).__name__}: {' '.join(str(fault).split())}"
    if not lines:
        at = next(iter(getattr(fault, "__notes__", [])), str(file))
        return f"{at}: the law fails: {message}; a law is law(T, now, p), the coefficient of a film coefficient(now, p)"
    at = f"{file}:{lines[-1]}"
    if isinstance(fault, AttributeError) and "SimpleNamespace" in message:
        return f"{at}: p has no {message.rsplit(' ', 1)[-1]}; it contains the parameters that the class declares"
    if isinstance(fault, AttributeError) and "LawContext" in message:
        return f"{at}: now has no {message.rsplit(' ', 1)[-1]}; docs/reference/effect_files.md lists the fields"
    if isinstance(fault, ZeroDivisionError):
        remedy = "declare that parameter with low > 0, or open_low=True" if "=" in where else HOLD_REMEDY
        return f"{at}: divides by zero where {where or 'the heat balance evaluates it'}; {remedy}"
    on_line = [what for line, what in _suspect_calls_below(_parse_file(file)) if line == lines[-1]]
    if on_line:
        return f"{at}: {on_line[0]}"
    if "truth value of an array" in message or "not supported between instances of 'complex'" in message:
        return f"{at}: `if`, `and` and max() take one number, but a law gets arrays; use where(real(x) > 0, a, b)"
    if "complex" in message or "safe" in message:
        return f"{at}: {message}; laws get complex numbers: {ALLOWED_OPERATIONS}"
    if "NoneType" in message:
        return f"{at}: {message}; not available for this quantity: docs/reference/effect_files.md has the list"
    return f"{at}: fails: {message}; repair that line"


def find_suspect_calls(file: Path, law: Callable) -> Iterator[tuple[int, str]]:
    """(line, message) of calls without a complex derivative in a law and in functions of its file that it calls."""
    while isinstance(law, partial):
        law = law.func
    tree, code = _parse_file(file), getattr(law, "__code__", None)
    functions = [n for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.Lambda))]
    pending = [n for n in functions if code and n.lineno == code.co_firstlineno]
    visited: list[ast.AST] = []
    while pending:
        node = pending.pop()
        if node in visited:
            continue
        visited.append(node)
        yield from _suspect_calls_below(node)
        names = {_function_name(c.func) for c in ast.walk(node) if isinstance(c, ast.Call)}
        pending += [f for f in functions if getattr(f, "name", None) in names]


def _parse_file(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def _suspect_calls_below(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Calls below a node without a complex derivative; comparisons are skipped, because they need none."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Compare):
            continue
        if isinstance(child, ast.Call) and (message := _explain_function(child.func)):
            yield child.lineno, message
        elif isinstance(child, ast.Attribute) and child.attr == "real":
            yield child.lineno, f".real drops the derivative; {NO_DERIVATIVE['real']}"
        yield from _suspect_calls_below(child)


def _explain_function(func: ast.expr) -> str | None:
    """The message for a function without a complex derivative, or None."""
    name = _function_name(func)
    known = SYNONYMS.get(name, name)
    if known in NO_DERIVATIVE:
        return f"{name}() has no complex derivative; {NO_DERIVATIVE[known]}"
    if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name) and func.value.id == "math":
        return f"math.{name}() takes neither arrays nor complex numbers; use np.{name}()"
    return None


def _function_name(func: ast.expr) -> str:
    return func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")
