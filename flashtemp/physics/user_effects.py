"""Effects from outside the catalogue: files of the user (permission to run them: model/trust), installed packages."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType

from flashtemp.errors import BadInput
from flashtemp.physics.effect import Effect, catalogue, find_only_effect

ENTRY_POINT_GROUP = "flashtemp.effects"
ALLOWED_IMPORTS_TEXT = "the standard library, numpy, scipy, flashtemp.physics and flashtemp.errors"


def read_effect(path: Path) -> type[Effect]:
    """Execute a file and return the effect that it defines; the effect's name is the file's stem.

    Raises BadInput with file, line and remedy: no such file, an invalid name or one of the catalogue, a file that does
    not run, no effect in it or more than one.
    """
    effect_name(path)
    return execute_source(str(path), _read_source(path))


def _read_source(path: Path) -> str:
    """The text of an effect file.  Raises BadInput."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as fault:
        raise BadInput(f"{path}: not a text file; give a Python file with one effect") from fault
    except OSError as fault:
        raise BadInput(f"{path}: {fault.strerror}; give a Python file with one effect") from fault


def effect_name(path: Path) -> str:
    """The name of the effect in a file.  Raises BadInput when the name is invalid, or the catalogue has it."""
    name = path.stem
    if path.suffix != ".py" or not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise BadInput(
            f"{path}: the file names the effect; use lower-case letters, digits, underscores and .py, such as fan.py"
        )
    if name in catalogue():
        raise BadInput(f"{path}: the catalogue has an effect '{name}'; give the file another name")
    return name


@cache
def execute_source(file: str, source: str) -> type[Effect]:
    """The effect that the source text of `file` defines; the same text gives the same class.  Raises BadInput."""
    name = f"flashtemp_own_{Path(file).stem}_{sha256((file + source).encode()).hexdigest()[:12]}"
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module  # dataclasses and doctests look their module up there
    try:
        _run_user_code(file, lambda: exec(compile(source, file, "exec"), vars(module)))
        effect = find_only_effect(module)
        if effect.base:
            raise BadInput(f"{file}: base = True is for the catalogue; leave it out, and list the effect in effects")
    except BadInput:
        del sys.modules[name]
        raise
    return effect


def _run_user_code(file: str, work: Callable[[], object]) -> None:
    """Run `work`, which executes a user's file; any exception becomes BadInput with the line of that file."""
    try:
        work()
    except SyntaxError as fault:
        raise BadInput(f"{file}:{fault.lineno}: {fault.msg}; repair that line") from fault
    except (Exception, SystemExit) as fault:
        lines = [f.lineno for f in traceback.extract_tb(fault.__traceback__) if f.filename == file]
        reason = f"{type(fault).__name__}: {fault}".rstrip(": ")
        remedy = f"import from {ALLOWED_IMPORTS_TEXT}" if isinstance(fault, ImportError) else "repair that line"
        raise BadInput(f"{file}:{lines[-1] if lines else 1}: does not run: {reason}; {remedy}") from fault


@cache
def find_installed_effects() -> dict[str, type[Effect]]:
    """Effects by name that installed packages declare under the entry-point group "flashtemp.effects".

    Raises BadInput for one that cannot be loaded, is not an effect, or has a name that is already in use.
    """
    found: dict[str, type[Effect]] = {}
    origin = {name: f"{ENTRY_POINT_GROUP}: the catalogue of flashtemp" for name in catalogue()}
    for point in sorted(entry_points(group=ENTRY_POINT_GROUP), key=lambda p: p.name):
        source = f"{point.value} of the package {point.dist.name}" if point.dist else point.value
        if point.name in origin:
            raise BadInput(
                f"{ENTRY_POINT_GROUP}: {source} takes the name '{point.name}' of {origin[point.name]};"
                " remove one of them"
            )
        origin[point.name] = source
        found[point.name] = _load_entry_point(point, source)
    return found


def _load_entry_point(point: EntryPoint, origin: str) -> type[Effect]:
    """The effect that an entry point names: a class, or a module with exactly one."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", point.name):
        raise BadInput(
            f"{ENTRY_POINT_GROUP}: '{point.name}' of {origin}: use lower-case letters, digits and underscores"
        )
    try:
        value = point.load()
    except Exception as fault:
        raise BadInput(
            f"{ENTRY_POINT_GROUP}: {origin} does not load: {fault}; repair or remove that package"
        ) from fault
    effect = find_only_effect(value) if isinstance(value, ModuleType) else value
    if not (isinstance(effect, type) and issubclass(effect, Effect)) or effect.base:
        raise BadInput(
            f"{ENTRY_POINT_GROUP}: {origin} is not an effect; name a subclass of Effect (base = False)"
            " or a module with one"
        )
    return effect


@dataclass(frozen=True)
class UserEffect:
    """An effect file after reading: `name`, its `path` as the case gives it, the `file` itself, and its `source` text.

    It carries the text, so that another process runs exactly what was read and checked here.
    """

    name: str
    path: str
    file: str
    source: str

    @property
    def effect(self) -> type[Effect]:
        """The effect that the text defines."""
        return execute_source(self.file, self.source)

    @property
    def sha256(self) -> str:
        """SHA-256 digest of the text."""
        return sha256(self.source.encode()).hexdigest()


def read_user_effect(path: str, folder: Path) -> UserEffect:
    """Read and execute the effect file `path` of a case in `folder`.  Raises BadInput as `read_effect` does."""
    file = folder / path
    found = UserEffect(effect_name(file), path, str(file), _read_source(file))
    _ = found.effect
    if found.name in find_installed_effects():
        raise BadInput(f"{file}: an installed package has an effect '{found.name}'; give the file another name")
    return found
