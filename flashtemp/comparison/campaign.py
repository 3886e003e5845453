"""A campaign: the case that is believed, and the recordings and load-cell traces that it is held to (contract 5.4)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from flashtemp.camera import recording, synthetic
from flashtemp.camera.recording import Recording
from flashtemp.errors import BadInput, nearest
from flashtemp.model import case as cases
from flashtemp.model import case_file
from flashtemp.physics.interpolation import pairs

NETD = 0.05  # K, of a camera that is imagined
TOP = {"title", "case", "free", "candidates", "recording", "force"}
ENTRY = {"recording": {"file", "view", "with", "sigma_K", "held_out"}, "force": {"file", "with", "sigma", "held_out"}}


@dataclass(frozen=True)
class View:
    """A recording of a campaign: `given` overrides of the case, `sigma_K` noise of one pixel of one frame."""

    file: str
    recording: Recording
    given: dict[str, Any] = field(default_factory=dict)
    sigma_K: float | None = None
    held_out: bool = False


@dataclass(frozen=True)
class Force:
    """A load-cell trace: `time` (n,) s, `mu` (n,), `sigma` of one reading."""

    file: str
    time: tuple[float, ...]
    mu: tuple[float, ...]
    given: dict[str, Any] = field(default_factory=dict)
    sigma: float | None = None
    held_out: bool = False


@dataclass(frozen=True)
class Campaign:
    """`case` file, names of `free` nuisance parameters, views and forces; `folder` where files are looked up.

    `trust`: effect files of the case run whose ever they are.
    """

    title: str
    case: Path
    free: tuple[str, ...]
    views: tuple[View, ...]
    forces: tuple[Force, ...]
    folder: Path
    candidates: tuple[str, ...] | None = None
    trust: bool = False

    def load(self, given: dict[str, Any]) -> cases.Case:
        """The case under the conditions of one entry."""
        return cases.load(self.case, given, trust=self.trust)

    def __str__(self) -> str:
        lines = [f"Campaign '{self.title}': {len(self.views)} recordings, {len(self.forces)} load-cell traces"]
        for entry in (*self.views, *self.forces):
            lines.append(f"  {entry.file}: {told(entry.given)}{' (held out)' if entry.held_out else ''}")
        return "\n".join(lines)


def told(given: dict[str, Any]) -> str:
    """A condition in words.

    >>> told({"schedule.speed": 0.1}), told({})
    ('schedule.speed = 0.1', 'the case')
    """
    return ", ".join(f"{k} = {v:g}" if isinstance(v, float) else f"{k} = {v}" for k, v in given.items()) or "the case"


def load(path, planned: bool = False, trust: bool = False) -> Campaign:
    """Read campaign.toml (or a folder that holds it) and everything it names.

    With `planned`, a recording may give a `view` instead of a file: what a camera would take is then imagined.
    `trust` lets effect files of the case run whose ever they are.  Raises BadInput with all faults at once, one line
    each.
    """
    path = Path(path)
    file = path / "campaign.toml" if path.is_dir() else path
    if not file.is_file():
        raise BadInput(f"{path}: no such campaign; give a folder with a campaign.toml or a .toml file")
    text, raw = case_file.read_toml(file)
    where, faults, folder = case_file.Places(str(file), text), [], file.parent
    for key in raw.keys() - TOP:
        faults.append(f"{where(key)}: unknown key{nearest(key, sorted(TOP))}")
    case = _case(raw, where, folder, faults)
    believed = _believed(case, trust, faults)
    under = None if believed is None else partial(cases.load, case, trust=trust)
    entries = {kind: _entries(raw, kind, where, faults) for kind in ENTRY}
    views = [
        v for n, e in enumerate(entries["recording"], 1) if (v := _view(e, n, where, under, folder, faults, planned))
    ]
    forces = [f for n, e in enumerate(entries["force"], 1) if (f := _force(e, n, where, under, folder, faults))]
    if not faults and not views and not forces:
        faults.append(f"{file}: holds no [[recording]] and no [[force]]; add at least one")
    able = believed.known if believed is not None else cases.known()
    for key in ("free", "candidates"):
        value = raw.get(key, [])
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            faults.append(f"{where(key)}: {value!r}; give a list of names in quotes")
        elif key == "candidates":
            faults += [
                f"{where(key)}: effect '{n}' is not in the catalogue{nearest(n, able)}" for n in value if n not in able
            ]
    if not isinstance(raw.get("title", ""), str):
        faults.append(f"{where('title')}: {raw['title']!r}; give text in quotes")
    if faults:
        raise BadInput(*faults)
    free = raw.get("free", list(believed.free))
    known = [f"{t}.{k}" for t, d in believed.values.items() for k in d if "number" in believed.declared(t)[k].kinds]
    for key in free:
        if key not in known:
            raise BadInput(f"{where('free')}: {key!r} is not a number of this case{nearest(str(key), known)}")
    candidates = raw.get("candidates")
    return Campaign(
        raw.get("title", file.resolve().parent.name), case, tuple(free), tuple(views), tuple(forces), folder,
        None if candidates is None else tuple(candidates), trust,
    )  # fmt: skip


def _case(raw, where, folder: Path, faults: list[str]) -> Path | None:
    name = raw.get("case", "case.toml")
    if not isinstance(name, str):
        faults.append(f"{where('case')}: {name!r}; give the name of a case file in quotes")
        return None
    path = folder / name
    if not path.exists():
        faults.append(f"{where('case')}: no file '{name}' in {folder}; give the case that is believed")
        return None
    return path


def _believed(case: Path | None, trust: bool, faults: list[str]) -> cases.Case | None:
    """The case as it stands; None, and its faults told once, when it cannot be loaded."""
    try:
        return None if case is None else cases.load(case, trust=trust)
    except BadInput as fault:
        faults.extend(fault.lines)
        return None


def _entries(raw, kind: str, where, faults: list[str]) -> list[dict]:
    entries = raw.get(kind, [])
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        faults.append(f"{where(kind)}: write [[{kind}]] and its keys below it")
        return []
    for number, entry in enumerate(entries, 1):
        for key in entry.keys() - ENTRY[kind]:
            faults.append(f"{where(kind)}: {kind} {number}: {key}: unknown key{nearest(key, sorted(ENTRY[kind]))}")
    return entries


def _imagined(view: str, case: cases.Case) -> Recording:
    """What a camera would take of a condition: four frames of every sliding, one of every wait."""
    scene = cases.build(case)
    return synthetic.blank(view, scene, *synthetic.moments(scene.schedule, 4, 1), NETD)


def _common(entry, kind: str, number: int, where, under, folder, faults, imagined: bool = False) -> dict | None:
    """Keys that recordings and forces share, checked; None when the entry cannot be used."""
    place, good = f"{where(kind)}: {kind} {number}", len(faults)
    file, given, held = entry.get("file"), entry.get("with", {}), entry.get("held_out", False)
    if imagined:
        pass
    elif not isinstance(file, str):
        more = "; a view without a file is for flashtemp plan" if "view" in entry else ""
        faults.append(f"{place}: file: {file!r}; give the name of a file in quotes{more}")
    elif not (folder / file).is_file():
        faults.append(f"{place}: file: no file '{file}' in {folder}")
    if not isinstance(held, bool):
        faults.append(f"{place}: held_out: {held!r}; give true or false")
    if not isinstance(given, dict):
        faults.append(f'{place}: with: {given!r}; write with = {{ "contact.pressure" = 1.5e5 }}')
    elif under is not None:
        try:
            under(given, by="with")
        except BadInput as fault:
            faults.extend(f"{place}: {line}" for line in fault.lines)
    name = "sigma_K" if kind == "recording" else "sigma"
    sigma = entry.get(name)
    if sigma is not None and (isinstance(sigma, bool) or not isinstance(sigma, (int, float)) or not 0 < sigma < 1e3):
        faults.append(f"{place}: {name}: {sigma!r}; give a number > 0, or leave it out to have it estimated")
    return None if len(faults) > good else {"file": file, "given": given, "held_out": held}


def _view(entry, number, where, under, folder, faults, planned: bool) -> View | None:
    imagined = planned and "view" in entry and "file" not in entry
    if imagined and entry["view"] not in synthetic.FACES:
        known = ", ".join(synthetic.FACES)
        faults.append(f"{where('recording')}: recording {number}: view: {entry['view']!r}; give {known}")
        return None
    common = _common(entry, "recording", number, where, under, folder, faults, imagined)
    if common is None:
        return None
    if imagined:
        common["file"] = f"planned {number} {entry['view']}"
        taken = _imagined(entry["view"], under(common["given"]))
        return View(recording=taken, sigma_K=entry.get("sigma_K"), **common)
    try:
        return View(recording=recording.load(folder / common["file"]), sigma_K=entry.get("sigma_K"), **common)
    except BadInput as fault:
        faults.extend(fault.lines)
        return None


def _force(entry, number, where, under, folder, faults) -> Force | None:
    common = _common(entry, "force", number, where, under, folder, faults)
    if common is None:
        return None
    try:
        time, mu = pairs(common["file"], folder, "file")
    except BadInput as fault:
        faults.extend(f"{where('force')}: force {number}: {line}" for line in fault.lines)
        return None
    return Force(time=time, mu=mu, sigma=entry.get("sigma"), **common)
