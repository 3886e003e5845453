"""Which wait between repetitions keeps a block below a temperature: the shortest, by marching the case.

While it waits the block gives its heat to air and holder and the track forgets its own, so that the highest
temperature of the later repetitions falls with the wait, towards what one repetition reaches alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.solver.march import march

TRIED_WAITS_S = (600.0, 21600.0)  # s: the waits tried before giving up
TEMPERATURE_TOLERANCE_K = 0.02  # K below the limit: near enough to stop
WAIT_TOLERANCE = 0.01  # of the wait: fine enough to stop (s for waits below 1 s)
MAX_MARCHES = 9  # marches between a wait that is too short and one that is long enough
SURFACE_PROFILES = {"block": "T_block", "spot": "T_spot"}
COOLING_REMEDY = (
    "lower contact.pressure (the rise follows it about in proportion), schedule.speed (about as its root) "
    "or schedule.distance"
)


@dataclass(frozen=True)
class PeakTemperature:
    """Highest temperature of a march with `wait` (s): degC, its repetition, that of the first one; s in all."""

    wait: float
    highest: float
    repetition: int
    first: float
    total: float


@dataclass(frozen=True, repr=False)
class WaitResult(DisplayMixin):
    """Answer of `find_minimum_wait`: `wait` in s, or None where no wait keeps the block `below` (degC).

    `reached` (degC) highest with that wait, or with the longest one tried; `repetition` in which;
    `too_short` longest wait (s) below it that is too hot; `total` length of the test (s); `tried` every march.
    """

    of: str
    below: float
    says: str
    wait: float | None
    reached: float
    repetition: int
    too_short: float | None
    total: float
    tried: tuple[PeakTemperature, ...]

    def as_dict(self) -> dict:
        """For --json."""
        return asdict(self)

    def __str__(self) -> str:
        if self.wait is None:
            return f"{self.says}\n  {COOLING_REMEDY}"
        lines = [
            self.says,
            f"  highest {self.reached:.2f} degC, in repetition {self.repetition}; the test takes {format_duration(self.total)}",
        ]
        for peak in self.tried:
            if peak.wait == self.too_short:
                lines.append(f"  {peak.wait:.4g} s are too short: {peak.highest:.2f} degC")
        return "\n".join(lines)

    def to_table(self) -> DisplayTable:
        rows = [(p.wait, p.highest, p.repetition, format_duration(p.total)) for p in self.tried]
        return DisplayTable(
            self.says, rows, ("wait, s", "highest, degC", "in repetition", "the test takes"),
            [] if self.wait is not None else [COOLING_REMEDY],
        )  # fmt: skip


def format_duration(seconds: float) -> str:
    """A duration for people.

    >>> format_duration(75), format_duration(440), format_duration(9000)
    ('75 s', '7.33 min', '2.5 h')
    """
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def find_minimum_wait(
    case: cases.Case, below: float, of: str = "block", watch: Callable[[str], None] = lambda text: None
) -> WaitResult:
    """The shortest schedule.wait with which the block's surface, or its spots, stays below `below` degC throughout.

    To 1 % of the wait or 0.02 K.  Raises BadInput, SolverFailure.
    """
    from scipy.optimize import brentq

    _check_question(case, below, of)
    tried: dict[float, PeakTemperature] = {}

    def temperature_excess(u: float) -> float:
        """K above the limit for asinh of the wait in s; 0 where that is near enough to stop."""
        wait = math.sinh(u)
        if wait not in tried:
            tried[wait] = peak = _march_with_wait(case, wait, of)
            watch(f"wait {wait:.4g} s: {peak.highest:.2f} degC in repetition {peak.repetition}")
        over = tried[wait].highest - below
        return 0.0 if -TEMPERATURE_TOLERANCE_K <= over <= 0 else over

    low = 0.0
    if temperature_excess(low) > 0 and tried[low].first <= below:
        for long in TRIED_WAITS_S:
            if temperature_excess(high := math.asinh(long)) <= 0:
                brentq(temperature_excess, low, high, xtol=WAIT_TOLERANCE, maxiter=MAX_MARCHES, disp=False)
                break
            low = high
    return _build_result(case, below, of, sorted(tried.values(), key=lambda peak: peak.wait))


def _build_result(case: cases.Case, below: float, of: str, tried: list[PeakTemperature]) -> WaitResult:
    """The shortest of the waits tried that is long enough, in words."""
    what = "the block's surface" if of == "block" else "the spots"
    found = next((p for p in tried if p.highest <= below), None)
    hot = [p.wait for p in tried if p.highest > below and (found is None or p.wait < found.wait)]
    last, ambient = found or tried[-1], case["ambient.temperature"]
    if found:
        need = "no wait is needed" if found.wait == 0.0 else f"wait {_round_up(found.wait):g} s between repetitions"
        says = f"{need} to keep {what} below {below:g} degC"
    else:
        says = f"no wait keeps {what} below {below:g} degC: "
        if last.first > below:
            top = last.first
            says += f"the first repetition alone reaches {top:.2f} degC"
        else:
            top = last.highest
            says += (
                f"{top:.2f} degC even with {format_duration(last.wait)} of it, {tried[0].highest:.2f} degC with none"
            )
        says += f"; the rise must fall by {math.ceil(100 * (top - below) / (top - ambient))} %"
    return WaitResult(
        of, below, says, None if found is None else found.wait, last.highest, last.repetition,
        max(hot, default=None), last.total, tuple(tried),
    )  # fmt: skip


def _round_up(wait: float) -> float:
    """A wait rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(wait)) - 2)
    return math.ceil(wait / unit) * unit


def _check_question(case: cases.Case, below: float, of: str) -> None:
    """BadInput unless the question has a meaning."""
    ambient, repetitions = case["ambient.temperature"], case["schedule.repetitions"]
    if of not in SURFACE_PROFILES:
        raise BadInput(f"--of: {of!r}; give {' or '.join(SURFACE_PROFILES)}")
    if not ambient < below < math.inf:
        raise BadInput(f"--below: {below:g} degC; give more than ambient.temperature = {ambient:g} degC")
    if repetitions < 2:
        file = case.folder / f"{case.name}.toml"
        file = file if file.is_file() else case.folder / "case.toml"
        raise BadInput(f"{file}: schedule.repetitions: {repetitions} leaves nothing to wait for; give 2 or more")


def _march_with_wait(case: cases.Case, wait: float, of: str) -> PeakTemperature:
    """March the case with another wait, without files."""
    other = replace(case, values=case.values | {"schedule": case.values["schedule"] | {"wait": wait}})
    scene = other.scene
    run = march(scene, replace(other.settings, fields=2))
    highest = np.nanmax(getattr(run, SURFACE_PROFILES[of]), axis=1)
    k = int(np.nanargmax(highest))
    first = float(np.nanmax(highest[run.repetition == 1]))
    return PeakTemperature(wait, float(highest[k]), int(run.repetition[k]), first, scene.schedule.end_time)
