"""Find the shortest wait between repetitions that keeps a block below a temperature, by simulating the case.

During a wait the block loses heat to air and holder, and the track cools.  The highest temperature of the later
repetitions therefore decreases with the wait, towards that of a single repetition.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput
from flashtemp.model import case as cases
from flashtemp.solver.time_integration import integrate_schedule

TRIED_WAITS_S = (600.0, 21600.0)  # s, upper bounds of the search in this order
TEMPERATURE_TOLERANCE_K = 0.02  # K below the limit at which the search stops
WAIT_TOLERANCE = 0.01  # relative tolerance of the wait (s for waits below 1 s)
MAX_MARCHES = 9  # runs of the root search between a wait that is too short and one that is long enough
SURFACE_PROFILES = {"block": "T_block", "spot": "T_spot"}
COOLING_REMEDY = (
    "lower contact.pressure (the temperature rise is about proportional), schedule.speed (about as its square root) "
    "or schedule.distance"
)


@dataclass(frozen=True)
class PeakTemperature:
    """`highest` temperature (degC) of a run with `wait` (s), its repetition, that of the `first`; `total` time (s)."""

    wait: float
    highest: float
    repetition: int
    first: float
    total: float


@dataclass(frozen=True, repr=False)
class WaitResult(DisplayMixin):
    """Result of `find_minimum_wait`: `wait` in s, or None where no wait keeps the block `below` (degC).

    `reached`: highest temperature (degC) with that wait, or with the longest one simulated, in `repetition`.
    `too_short`: longest wait (s) that is too hot; `total`: duration of the test (s); `tried`: all runs.
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
        """All numbers as plain data."""
        return asdict(self)

    def __str__(self) -> str:
        if self.wait is None:
            return f"{self.says}\n  {COOLING_REMEDY}"
        lines = [
            self.says,
            f"  highest {self.reached:.2f} degC, in repetition {self.repetition}; "
            f"the test takes {format_duration(self.total)}",
        ]
        for peak in self.tried:
            if peak.wait == self.too_short:
                lines.append(f"  {peak.wait:.4g} s is too short: {peak.highest:.2f} degC")
        return "\n".join(lines)

    def to_table(self) -> DisplayTable:
        rows = [(p.wait, p.highest, p.repetition, format_duration(p.total)) for p in self.tried]
        return DisplayTable(
            self.says, rows, ("wait, s", "highest, degC", "in repetition", "the test takes"),
            [] if self.wait is not None else [COOLING_REMEDY],
        )  # fmt: skip


def format_duration(seconds: float) -> str:
    """A duration in s, min or h.

    >>> format_duration(75), format_duration(440), format_duration(9000)
    ('75 s', '7.33 min', '2.5 h')
    """
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def find_minimum_wait(
    case: cases.Case, below: float, of: str = "block", watch: Callable[[str], None] = lambda text: None
) -> WaitResult:
    """The shortest schedule.wait with which the block surface, or its contact spots, always stays below `below` degC.

    Accuracy: 1 % of the wait or 0.02 K.  Raises BadInput, SolverFailure.
    """
    from scipy.optimize import brentq

    _check_question(case, below, of)
    tried: dict[float, PeakTemperature] = {}

    def temperature_excess(u: float) -> float:
        """K above the limit at u = asinh(wait in s); 0 within the tolerance, which ends the root search."""
        wait = math.sinh(u)
        if wait not in tried:
            tried[wait] = peak = _simulate_with_wait(case, wait, of)
            watch(f"wait {wait:.4g} s: {peak.highest:.2f} degC in repetition {peak.repetition}")
        over = tried[wait].highest - below
        return 0.0 if -TEMPERATURE_TOLERANCE_K <= over <= 0 else over

    low = 0.0
    if temperature_excess(low) > 0 and tried[low].first <= below:
        for longest in TRIED_WAITS_S:
            if temperature_excess(high := math.asinh(longest)) <= 0:
                brentq(temperature_excess, low, high, xtol=WAIT_TOLERANCE, maxiter=MAX_MARCHES, disp=False)
                break
            low = high
    return _build_result(case, below, of, sorted(tried.values(), key=lambda peak: peak.wait))


def _build_result(case: cases.Case, below: float, of: str, tried: list[PeakTemperature]) -> WaitResult:
    """The result from all simulated waits, with its sentence."""
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
                f"{top:.2f} degC even after {format_duration(last.wait)}, {tried[0].highest:.2f} degC without a wait"
            )
        says += f"; the temperature rise must decrease by {math.ceil(100 * (top - below) / (top - ambient))} %"
    return WaitResult(
        of, below, says, None if found is None else found.wait, last.highest, last.repetition,
        max(hot, default=None), last.total, tuple(tried),
    )  # fmt: skip


def _round_up(wait: float) -> float:
    """A wait (s) rounded up to three digits."""
    unit = 10.0 ** (math.floor(math.log10(wait)) - 2)
    return math.ceil(wait / unit) * unit


def _check_question(case: cases.Case, below: float, of: str) -> None:
    """Raise BadInput for an unknown quantity, a limit below ambient, or a single repetition."""
    ambient, repetitions = case["ambient.temperature"], case["schedule.repetitions"]
    if of not in SURFACE_PROFILES:
        raise BadInput(f"--of: {of!r}; give {' or '.join(SURFACE_PROFILES)}")
    if not ambient < below < math.inf:
        raise BadInput(f"--below: {below:g} degC; give more than ambient.temperature = {ambient:g} degC")
    if repetitions < 2:
        file = case.folder / f"{case.name}.toml"
        file = file if file.is_file() else case.folder / "case.toml"
        raise BadInput(f"{file}: schedule.repetitions: {repetitions} leaves nothing to wait for; give 2 or more")


def _simulate_with_wait(case: cases.Case, wait: float, of: str) -> PeakTemperature:
    """Run the case with another wait (s), without writing files."""
    other = replace(case, values=case.values | {"schedule": case.values["schedule"] | {"wait": wait}})
    scene = other.scene
    run = integrate_schedule(scene, replace(other.settings, fields=2))
    highest = np.nanmax(getattr(run, SURFACE_PROFILES[of]), axis=1)
    k = int(np.nanargmax(highest))
    first = float(np.nanmax(highest[run.repetition == 1]))
    return PeakTemperature(wait, float(highest[k]), int(run.repetition[k]), first, scene.schedule.end_time)
