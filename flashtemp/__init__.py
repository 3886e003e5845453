"""flashtemp: where the heat of a sliding rubber block goes, and what your model of it is missing."""

from __future__ import annotations

from importlib import import_module

__version__ = "0.1.0"

_PUBLIC = {
    "load": "model.case",
    "build": "model.case",
    "Case": "model.case",
    "simulate": "api.simulation",
    "Run": "solver.run",
    "open_fields": "runs.vtk",
    "Effect": "physics.effect",
    "Param": "physics.effect",
    "catalogue": "physics.effect",
    "converge": "runs.convergence",
    "BadInput": "errors",
    "SolverFailure": "errors",
}
__all__ = sorted(_PUBLIC)


def __getattr__(name: str):
    if name in _PUBLIC:
        return getattr(import_module(f"flashtemp.{_PUBLIC[name]}"), name)
    raise AttributeError(f"module 'flashtemp' has no attribute '{name}'")


def __dir__():
    return __all__
