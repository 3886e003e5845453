"""Checks of the file of an effect: imports, example, texts and parameters."""

from __future__ import annotations

import ast
import doctest
import inspect
import math
import re
import sys

from flashtemp.physics.effect import Effect, Param
from flashtemp.runs.checks.effect_check.findings import Finding, make_finding
from flashtemp.runs.checks.effect_check.fixtures import EffectUnderTest

MAX_FILE_LINES = 120  # so that one effect can be read at a glance
ALLOWED_PACKAGES = sys.stdlib_module_names | {"numpy", "scipy"}
UNIT_SYMBOLS = "1 m mm um nm km s ms us min h kg g K degC Pa kPa MPa GPa W mW kW J kJ MJ N kN rad deg px eV Hz mol"
UNIT_SYMBOL_PATTERN = "|".join(sorted(UNIT_SYMBOLS.split(), key=len, reverse=True))
UNIT_TEXT_PATTERN = re.compile(rf"(?:(?:{UNIT_SYMBOL_PATTERN})(?:\d+|\^-?\d+(?:\.\d+)?)?)+")
UNIT_CORRECTIONS = {
    "C": "degC",
    "°C": "degC",
    "celsius": "degC",
    "Celsius": "degC",
    "%": "1, a fraction",
    "-": "1",
    "kelvin": "K",
}


def check_file(trial: EffectUnderTest) -> Finding:
    """Check that the file is short, contains one effect and begins with a text."""
    text, module = trial.file.read_text(encoding="utf-8"), trial.module
    own = [c for c in vars(module).values() if inspect.isclass(c) and c.__module__ == module.__name__]
    effects = {c for c in own if issubclass(c, Effect)}
    lines = len(text.splitlines())
    faults = []
    if effects != {trial.effect}:
        faults.append(f"{trial.file}: contains {len(effects)} effects; write one file for each")
    if lines >= MAX_FILE_LINES:
        faults.append(
            f"{trial.file}: has {lines} lines; keep it below {MAX_FILE_LINES}, and long computations elsewhere"
        )
    if not (module.__doc__ or "").strip():
        faults.append(f"{trial.file}:1: no docstring; begin with one sentence in triple quotes: what the effect does")
    return make_finding("file", faults, f"contains one effect, {trial.effect.__name__}, in {lines} lines")


def check_imports(trial: EffectUnderTest) -> Finding:
    """Check that the file imports only the standard library, numpy, scipy and the base of effects."""
    faults, package = [], trial.effect.__module__.split(".")[0]
    for node in ast.walk(ast.parse(trial.file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = ["." * node.level + (node.module or "")]
        else:
            continue
        for name in names:
            allowed = name == "flashtemp.errors" or name.split(".")[:2] == ["flashtemp", "physics"]
            allowed |= name.split(".")[0] in {"", package} - {"flashtemp"}  # its own package
            if not allowed and name.split(".")[0] not in ALLOWED_PACKAGES:
                faults.append(
                    f"{trial.file}:{node.lineno}: imports {name}; an effect may use the standard library, numpy, "
                    "scipy, flashtemp.physics and flashtemp.errors"
                )
    return make_finding("imports", faults, "all imports are allowed")


def check_example(trial: EffectUnderTest) -> Finding:
    """Check that the first docstring contains an example, and that all examples are correct."""
    module, path = trial.module, trial.file
    if ">>> " not in (module.__doc__ or ""):
        return Finding(
            "example",
            False,
            f"{path}:1: no example; add one to its docstring: >>> and the output of Python",
        )
    reports: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    tests = doctest.DocTestFinder().find(module)
    for test in tests:
        runner.run(test, out=reports.append)
    count = sum(len(t.examples) for t in tests)
    return make_finding("example", _failed_examples(reports, path), f"{count} lines of example, all correct")


def _failed_examples(reports: list[str], path) -> list[str]:
    """One line for every failure that doctest reports."""
    faults = []
    for text in reports:
        line = re.search(r"line (\d+), in", text)
        matches = {k: re.search(rf"{k}:\n((?:    .*\n?)+)", text) for k in ("Failed example", "Expected", "Got")}
        shown = {k: " ".join(found[1].split()) for k, found in matches.items() if found}
        if "Failed example" in shown:
            got = shown.get("Got", text.strip().splitlines()[-1].strip())
            expected = shown.get("Expected", "nothing")
            at = f"{path}:{line[1]}" if line else str(path)
            faults.append(f"{at}: `{shown['Failed example']}` gives {got}, the example says {expected}")
    return faults


def check_words(trial: EffectUnderTest) -> Finding:
    """Check that cause, source, signature and docstring of the effect are given."""
    effect, faults = trial.effect, []
    at = f"{trial.file}:{inspect.getsourcelines(effect)[1]}"
    required = {
        "cause": "what happens, in one sentence; `discover` reports it when it finds the effect",
        "source": "the origin of the law: paper, data sheet, or own measurement",
    }
    for key, what in required.items():
        value = getattr(effect, key)
        if not (isinstance(value, str) and value.strip()):
            faults.append(f'{at}: no {key}; add {key} = "..." ({what})')
    tells = effect.tells
    if not (isinstance(tells, tuple) and tells and all(isinstance(t, str) and t for t in tells)):
        faults.append(f'{at}: tells is {tells!r}; add tells = ("...",), a tuple of signs by which the effect shows')
    if not (effect.__dict__.get("__doc__") or "").strip():
        faults.append(f"{at}: the class has no docstring; state its law in one sentence in triple quotes")
    if effect.base and not effect.section:
        faults.append(f"{at}: a base effect names its table: section")
    return make_finding("words", faults, f"{effect.cause}; source: {effect.source}")


def check_parameters(trial: EffectUnderTest) -> Finding:
    """Check unit, bounds, default, meaning and neutral value of every parameter."""
    params, faults = trial.effect.params(), []
    lines = _lines_of_params(trial)
    for key, p in params.items():
        at = f"{trial.file}:{lines.get(key, 1)}: {key}"
        faults += [f"{at}: {fault}" for fault in _parameter_faults(p)]
    if not any(p.off is not None for p in params.values()):
        faults.append(
            f"{trial.file}: no parameter can switch the effect off; give one an off: "
            "the value at which a factor is 1 and a term 0"
        )
    faults += [
        f"{trial.file}:{lines.get(k, 1)}: {k} is in no law; use p.{k}, or leave it out"
        for k in _unused_parameters(trial)
    ]
    inherited = [k for c in trial.effect.__mro__[1:] for k, v in vars(c).items() if isinstance(v, Param)]
    faults += [f"{trial.file}: {k} is inherited; declare it in the class itself" for k in inherited]
    listed = ", ".join(f"{k} ({p.unit})" for k, p in params.items())
    return make_finding("parameters", faults, f"{listed}: with unit, bounds and meaning")


def _parameter_faults(p: Param) -> list[str]:
    """The errors in the declaration of a parameter."""
    out = []
    if not p.unit:
        out.append('no unit; give one, "1" for a plain number')
    elif wrong := find_unit_fault(p.unit):
        out.append(wrong)
    if not p.about.strip():
        out.append("not explained; describe it in a few words")
    if "number" not in p.kinds:
        return out
    if not p.low < p.high:
        out.append(f"bounds from {p.low:g} to {p.high:g}; give low < high")
    elif p.low == -math.inf and p.high == math.inf:
        out.append("no bounds; give low and high, between which it makes sense")
    if p.value is not None and (fault := p.find_fault(p.value)):
        out.append(f"its default {p.value!r} is out of bounds; {fault}")
    if p.off is not None and (fault := p.find_fault(p.off)):
        out.append(f"its off {p.off!r} is out of bounds; {fault}")
    return out


def find_unit_fault(unit: str) -> str | None:
    """The error of a unit, or None; units of the columns of a table are separated by commas.

    >>> find_unit_fault("W/m2K/(m/s)^0.8"), find_unit_fault("m2/N"), find_unit_fault("degC, 1")
    (None, None, None)
    >>> find_unit_fault("°C")
    "unit '°C'; write degC"
    """
    for one in unit.split(","):
        parts = re.sub(r"\)\^-?[\d.]+", ")", one.strip())
        for part in re.split(r"[/() *]+", parts):
            if part and not UNIT_TEXT_PATTERN.fullmatch(part):
                right = UNIT_CORRECTIONS.get(
                    part, "it as the catalogue does: 1/K, W/m2K, m2K/W, m/s, degC, 1 for a number"
                )
                return f"unit {unit!r}; write {right}"
    return None


def _unused_parameters(trial: EffectUnderTest) -> list[str]:
    """Parameters that the file does not use, unless its `prepare`, or the program itself, may use them."""
    if trial.effect.base or vars(trial.effect).get("prepare") is not None:
        return []
    nodes = list(ast.walk(ast.parse(trial.file.read_text(encoding="utf-8"))))
    if any(isinstance(n, ast.Name) and n.id in ("getattr", "vars") for n in nodes):
        return []
    used = {n.attr for n in nodes if isinstance(n, ast.Attribute)}
    used |= {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    return [k for k in trial.effect.params() if k not in used]


def _lines_of_params(trial: EffectUnderTest) -> dict[str, int]:
    """The line of the file in which each parameter is declared."""
    lines: dict[str, int] = {}
    for node in ast.walk(ast.parse(trial.file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef) and node.name == trial.effect.__name__:
            for line in node.body:
                targets = line.targets if isinstance(line, ast.Assign) else [getattr(line, "target", None)]
                lines |= {t.id: line.lineno for t in targets if isinstance(t, ast.Name)}
    return lines
