"""flashtemp: where the heat of a sliding rubber block goes, and what your model of it is missing.

Names are imported from their modules on first use, so that `import flashtemp` stays fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

_PUBLIC = {
    "api.inputs": ["load"],
    "api.drawing": ["draw"],
    "api.simulation": ["check", "simulate", "resume", "open_fields", "view"],
    "api.studies": ["sweep", "converge", "repetitions", "wait", "sensitivity"],
    "api.camera": ["import_recording", "inspect_files", "recording_template"],
    "api.campaigns": ["open_campaign", "compare", "discover", "plan", "twin"],
    "api.watching": ["watch"],
    "api.friction": ["compute_contact_area", "friction", "loads", "tread", "tyre", "spots", "spectrum"],
    "api.effects": ["effects", "check_effect"],
    "api.reports": ["report"],
    "api.templates": ["new"],
    "model.case": ["Case"],
    "solver.run": ["Run"],
    "comparison.campaign": ["Campaign"],
    "discovery.verdict": ["Verdict"],
    "errors": ["BadInput", "SolverFailure"],
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names}
__all__ = [
    "BadInput", "Campaign", "Case", "Run", "SolverFailure", "Verdict", "check", "check_effect", "compare",
    "compute_contact_area", "converge", "discover", "draw", "effects", "friction", "import_recording",
    "inspect_files", "load", "loads", "new", "open_campaign", "open_fields", "physics", "plan", "recording_template",
    "repetitions", "report", "resume", "sensitivity", "simulate", "spectrum", "spots", "sweep", "tread", "twin",
    "tyre", "view", "wait", "watch",
]  # fmt: skip

if TYPE_CHECKING:  # editors and type checkers do not run `__getattr__` below
    from flashtemp import physics
    from flashtemp.api.camera import import_recording, inspect_files, recording_template
    from flashtemp.api.campaigns import compare, discover, open_campaign, plan, twin
    from flashtemp.api.drawing import draw
    from flashtemp.api.effects import check_effect, effects
    from flashtemp.api.friction import compute_contact_area, friction, loads, spectrum, spots, tread, tyre
    from flashtemp.api.inputs import load
    from flashtemp.api.reports import report
    from flashtemp.api.simulation import check, open_fields, resume, simulate, view
    from flashtemp.api.studies import converge, repetitions, sensitivity, sweep, wait
    from flashtemp.api.templates import new
    from flashtemp.api.watching import watch
    from flashtemp.comparison.campaign import Campaign
    from flashtemp.discovery.verdict import Verdict
    from flashtemp.errors import BadInput, SolverFailure
    from flashtemp.model.case import Case
    from flashtemp.solver.run import Run


RENAMED = {"area": "compute_contact_area", "look": "inspect_files"}  # earlier names, which still work


def __getattr__(name: str) -> Any:
    if name in RENAMED:
        from flashtemp.errors import warn_renamed

        warn_renamed(f"flashtemp.{name}", f"flashtemp.{RENAMED[name]}")
        return __getattr__(RENAMED[name])
    if name in _HOME:
        return getattr(import_module(f"flashtemp.{_HOME[name]}"), name)
    if name == "__version__":
        return import_module("importlib.metadata").version("flashtemp")
    if name == "physics":
        return import_module("flashtemp.physics")
    raise AttributeError(f"module 'flashtemp' has no attribute '{name}'")


def __dir__() -> list[str]:
    return __all__
