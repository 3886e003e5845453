"""Numerical settings of a run: CVODE binding, tolerances, and how many records are saved."""

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
    """CVODE `binding`, `rtol`, `atol` (K), BDF `order`; `profiles` and `fields` saved per repetition and wait.

    `times` (s): additional times at which profiles and fields are saved; `hottest` (K): a run that exceeds it fails.
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
    """The binding to use.  Raises BadInput when `name`, or any binding, is not installed."""
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
    """Settings from the values {table: {key: value}} of a case.  Raises BadInput without its CVODE binding."""
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
