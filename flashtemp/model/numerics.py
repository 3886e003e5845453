"""Numerics of a run: CVODE's binding and tolerances, and how often what is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

BINDINGS = {"scikits-odes": "scikits_odes_sundials", "scikit-sundae": "sksundae"}


@dataclass(frozen=True)
class SolverSettings:
    """Numerics: CVODE `binding`, `rtol`, `atol` (K), BDF `order`; records per repetition and wait.

    `times` (s): moments at which profiles and fields are kept besides; `hottest` (K): hotter is a failure.
    """

    binding: str
    rtol: float = 1e-4
    atol: float | None = None
    order: int = 3
    profiles: int = 40
    fields: int = 6
    times: tuple[float, ...] = ()
    hottest: float = 600.0 + KELVIN


def installed_bindings() -> list[str]:
    """Bindings installed on this machine, the preferred one first."""
    return [name for name, module in BINDINGS.items() if find_spec(module)]


def choose_binding(name: str | None) -> str:
    """The binding to use; BadInput when the one asked for is not installed."""
    have = installed_bindings()
    if name in (None, "auto"):
        if not have:
            raise BadInput("numerics.integrator: no CVODE binding is installed; pip install scikit-sundae")
        return have[0]
    if name not in have:
        what = " or ".join(f'"{h}"' for h in have)
        raise BadInput(f'numerics.integrator: "{name}" is not installed here; use {what}')
    return name


def read_settings(values: Mapping[str, Mapping[str, Any]]) -> SolverSettings:
    """Numerics of a case's values {table: {key: value}}; BadInput when its CVODE binding is not installed."""
    n, out = values["numerics"], values["output"]
    hottest = values["limits"]["temperature"] + KELVIN
    return SolverSettings(
        choose_binding(n["integrator"]),
        n["rtol"],
        n["atol"],
        n["order"],
        out["profiles"],
        out["fields"],
        hottest=hottest,
    )
