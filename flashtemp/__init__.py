"""flashtemp: where the heat of a sliding rubber block goes, and what your model of it is missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_PUBLIC = {
    "api.inputs": ["load"],
    "api.simulation": ["check", "simulate", "resume", "open_fields", "view"],
    "api.questions": ["sweep", "converge", "repetitions", "wait"],
    "api.camera": ["import_recording", "recording_template"],
    "api.campaigns": ["open_campaign", "compare", "discover", "plan", "twin"],
    "api.friction": ["friction", "loads", "tread", "tyre", "spots", "spectrum"],
    "api.effects": ["effects", "check_effect"],
    "model.case": ["Case"],
    "solver.run": ["Run"],
    "comparison.campaign": ["Campaign"],
    "discovery.verdict": ["Verdict"],
    "errors": ["BadInput", "SolverFailure"],
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names}
__all__ = sorted([*_HOME, "physics"])


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"flashtemp.{_HOME[name]}"), name)
    if name == "physics":
        return import_module("flashtemp.physics")
    raise AttributeError(f"module 'flashtemp' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
