"""Check at load that an effect yields contributions to existing quantities and sites, so that typing errors show."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, FlashtempError, suggest_name
from flashtemp.physics.effect import Deposit, Effect, Factor, Heat, Term
from flashtemp.physics.quantities import CAMERA_QUANTITIES, QUANTITIES, SITES

Contributions = tuple[Heat | Factor | Term | Deposit, ...]


def check_balance_contributions(name: str, effect: Effect, scene: Any, p: Any) -> Contributions:
    """The contributions of an effect to the heat balance of a scene, checked.

    Raises BadInput naming the effect, the file and line of the law, and the closest known name.
    """
    parts = _collect_parts(name, lambda: effect.heat(scene, p), effect.heat)
    _raise_faults(name, parts, _find_balance_fault)
    return parts


def check_camera_contributions(name: str, effect: Effect, p: Any) -> Contributions:
    """The contributions of an effect to the camera's measurement, checked.  Raises BadInput likewise."""
    parts = _collect_parts(name, lambda: effect.see(p), effect.see)
    _raise_faults(name, parts, _find_camera_fault)
    return parts


def _collect_parts(name: str, parts: Callable[[], Iterable[Any]], method: Callable[..., Any]) -> Contributions:
    """All that a method of an effect yields; BadInput with file and line when it fails."""
    try:
        return tuple(parts())
    except FlashtempError:
        raise
    except Exception as fault:
        file = method.__code__.co_filename
        line = [f.lineno for f in traceback.extract_tb(fault.__traceback__) if f.filename == file][-1:]
        at = f"{file}:{line[0] if line else method.__code__.co_firstlineno}"
        reason = f"{type(fault).__name__}: {fault}"
        raise BadInput(
            f"effects: effect '{name}' ({at}): {method.__name__}() fails: {reason}; repair that line"
        ) from fault


def _raise_faults(name: str, parts: Contributions, fault_of: Callable[[Any], str | None]) -> None:
    faults = [f"effects: effect '{name}'{locate_law(p)}: {f}" for p in parts if (f := fault_of(p))]
    if faults:
        raise BadInput(*faults)


def locate_law(part: Any) -> str:
    """File and line of the law of a contribution, as " (file:line)"; empty for one without a law."""
    law = getattr(part, "law", None)
    while isinstance(law, partial):
        law = law.func
    code = getattr(law, "__code__", None)
    return f" ({code.co_filename}:{code.co_firstlineno})" if code else ""


def _find_balance_fault(part: Any) -> str | None:
    """The error text for a contribution to the heat balance, or None."""
    if isinstance(part, (Term, Factor)):
        if part.target in CAMERA_QUANTITIES:
            return f"{_describe_part(part)}: a quantity of the camera; yield it from see(), not from heat()"
        return _find_target_fault(part, QUANTITIES, "quantity")
    if isinstance(part, Heat):
        return _find_site_fault(part)
    if isinstance(part, Deposit):
        if not (_is_finite_number(part.share) and 0 <= np.real(part.share) <= 1):
            return f"Deposit(share={part.share!r}): give a share from 0 to 1"
        good = _is_finite_number(part.depth) and np.real(part.depth) > 0
        return None if good else f"Deposit(depth={part.depth!r}): give a depth > 0 in m"
    return f"heat() yields {part!r}; yield Heat, Term, Factor or Deposit"


def _find_site_fault(part: Heat) -> str | None:
    """The error text for heat on a site, or None."""
    if part.kind not in ("film", "patch", "zone"):
        return f"Heat of kind {part.kind!r}; write Heat.film, Heat.patch or Heat.zone"
    what = "zone" if part.kind == "zone" else "patch"
    sites = [n for n, s in SITES.items() if s.zone == (what == "zone")]
    if part.site in sites:
        return None
    return f'Heat.{part.kind}("{part.site}"): no such {what}{suggest_name(str(part.site), sites)}'


def _find_camera_fault(part: Any) -> str | None:
    """The error text for a contribution to the camera's measurement, or None."""
    if not isinstance(part, Term):
        return f"see() yields {part!r}; yield a Term of a quantity of the camera"
    if part.target in QUANTITIES:
        return f"{_describe_part(part)}: a quantity of the balance; yield it from heat(), not from see()"
    return _find_target_fault(part, CAMERA_QUANTITIES, "quantity of the camera")


def _find_target_fault(part: Term | Factor, known: Mapping[str, Any], what: str) -> str | None:
    return (
        None
        if part.target in known
        else f"{_describe_part(part)}: no such {what}{suggest_name(str(part.target), known)}"
    )


def _describe_part(part: Term | Factor) -> str:
    return f'{type(part).__name__}("{part.target}")'


def _is_finite_number(value: Any) -> bool:
    """Whether a number is finite; a complex one carries a derivative in its imaginary part."""
    return isinstance(value, (int, float, complex)) and not isinstance(value, bool) and math.isfinite(np.real(value))
