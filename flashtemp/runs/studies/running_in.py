"""Running-in: how many repetitions pass until data are reproducible, with the uncertainty of that number.

During running-in a quantity approaches its final value as final + (start - final) exp(-s/s_w) over the slid distance
s.  The value of a repetition is the mean of this law over its own distance.

>>> n = np.arange(6)
>>> value = 0.9 - 0.1 * np.exp(-n / 2.0)
>>> answer = fit_relaxation(MeanRecord(n, n, value, length=1.0, unit="repetitions"), within=0.01)
>>> round(answer.s_w, 6), answer.repetitions
(2.0, 5)
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from flashtemp.display import DisplayMixin, DisplayTable
from flashtemp.errors import BadInput, FlashtempError, shorten_text, suggest_name
from flashtemp.physics.quantities import KELVIN
from flashtemp.physics.tables.column_matching import FRICTION, RequiredColumn, read_required_columns
from flashtemp.physics.tables.header import split_label
from flashtemp.physics.tables.table import read_table
from flashtemp.runs.studies.relaxation_fit import MeanRecord, RelaxationFit, drop_first

MIN_FIT_VALUES = 4  # three parameters are fitted
MAX_CSV_ROWS = 5000  # more rows are a time series with correlated neighbours, not means
MAX_EXTRAPOLATION = 3.0  # s_w over the length of the data, above which s_w is not reported
INTERVAL_CONFIDENCE = 0.95
MISFIT_CONFIDENCE = 0.99  # of the remark that the values are not exponential
RELAXATION_PARAMETERS = 2  # additional parameters of a relaxation compared with a constant
RECORD_QUANTITIES, CSV_HEADER_WORDS = ("friction", "pressure"), "repetition,mu[,sigma] or slid_m,mu[,sigma]"
REPETITION_COLUMN = RequiredColumn("repetition", "1", "repetition")
SLID_COLUMN = RequiredColumn("slid distance", "m", "slid")
SIGMA_COLUMN = RequiredColumn("standard deviation", "1", "sigma")


@dataclass(frozen=True, repr=False)
class RunningInResult(DisplayMixin):
    """Result of `fit_relaxation`; distances in `unit`, None where the data do not determine a number.

    `s_w` with standard error and 95 % interval; `start` and `final` value.  After the distance `slid`, or the number
    of `repetitions`, the remaining change is below `within`.  `scatter`: standard deviation of one value around the
    fit; `says`: the result in one sentence, with `notes`; `expected`: s_w that the case implies, m.
    """

    of: str
    unit: str
    within: float
    says: str
    notes: tuple[str, ...] = ()
    scatter: float | None = None
    s_w: float | None = None
    s_w_error: float | None = None
    s_w_interval: tuple[float, float] | None = None
    start: float | None = None
    final: float | None = None
    slid: float | None = None
    slid_interval: tuple[float, float] | None = None
    repetitions: int | None = None
    repetitions_interval: tuple[float, float] | None = None
    expected: float | None = None

    def as_dict(self) -> dict:
        """All numbers as plain data."""
        return asdict(self)

    def __str__(self) -> str:
        lines = [f"{self.of}: {self.says}"]
        if self.s_w is not None and self.s_w_interval is not None:
            low, high = self.s_w_interval
            lines.append(
                f"  relaxes over s_w = {self.s_w:.3g} +- {self.s_w_error:.2g} {self.unit} "
                f"(95 %: {low:.3g} to {high:.3g}), from {self.start:.4g} to {self.final:.4g}"
            )
        if self.expected is not None:
            sooner = "; friction may settle over half of it" if self.of == "friction" else ""
            lines.append(f"  the case implies s_w = {self.expected:.3g} m for its pressure, 1/(k_n k mu){sooner}")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])

    def to_table(self) -> DisplayTable:
        units = {"s_w": self.unit, "slid": self.unit, "expected": "m", "start": "1", "final": "1", "scatter": "1"}
        rows = [
            (name, getattr(self, name), getattr(self, f"{name}_interval", None), units.get(name, ""))
            for name in ("s_w", "start", "final", "scatter", "slid", "repetitions", "expected")
            if getattr(self, name) is not None
        ]
        return DisplayTable(f"{self.of}: {self.says}", rows, ("", "value", "95 %", "unit"), self.notes)


def analyse_running_in(
    source, within: float = 0.01, distance: float | None = None, of: str = "friction"
) -> RunningInResult:
    """Read a result folder or a CSV file and estimate after how many repetitions its changes are below `within`.

    `distance`: distance slid per repetition of a CSV file, m.  Raises BadInput.
    """
    return fit_relaxation(read_record(source, distance, of), within)


def fit_relaxation(record: MeanRecord, within: float = 0.01) -> RunningInResult:
    """Fit the relaxation of a record; numbers that its data do not determine are None.  Raises BadInput.

    Intervals are those of the profile likelihood, with the scatter from the residuals unless `sigma` is given.
    """
    if not 0 < within < 1:
        raise BadInput(f"--within: {within:g}; give a fraction between 0 and 1, for example 0.01")
    n, notes = len(record.value), []
    blank = RunningInResult(record.of, record.unit, within, "", expected=record.expected)
    if n < MIN_FIT_VALUES:
        return replace(
            blank, says=f"{n} values are too few; at least {MIN_FIT_VALUES} repetitions are needed, more are better"
        )
    fit = RelaxationFit(record)
    if record.sigma is None and not record.simulated:
        notes.append("the scatter is estimated from the residuals of the fit")
    elif record.sigma is not None and not fit.trusted:
        notes.append(
            f"the values scatter {math.sqrt(fit.variance):.1f} times as much as their sigma states: intervals widened"
        )
    if fit.constant <= fit.chi2_limit(INTERVAL_CONFIDENCE, RELAXATION_PARAMETERS):
        spread = float(np.std(record.value, ddof=1))
        ratio = spread if record.absolute else spread / (abs(float(np.mean(record.value))) or 1.0)
        says = f"no relaxation detected: the change is below the scatter; already reproducible to {100 * ratio:.2g} %"
        return replace(blank, says=says, scatter=spread, notes=(*_averaging_advice(ratio, within), *notes))
    blank = replace(blank, scatter=fit.scatter, notes=tuple(notes))
    low, high = fit.s_w_interval(fit.chi2_limit(INTERVAL_CONFIDENCE))
    span = float(record.end[-1] - record.begin[0])
    if high < math.inf and fit.s_w <= MAX_EXTRAPOLATION * span:
        return _determined_result(record, fit, blank)
    missing = max(2 * low - span, 0.5 * span)
    more = f"{missing:.3g} more metres" if record.unit == "m" else f"{math.ceil(missing)} more repetitions"
    sure = "is" if low > span else "may be"
    says = (
        f"relaxation {sure} longer than your data, s_w at least {low:.3g} {record.unit} (95 %): slide at least {more}"
    )
    return replace(blank, says=says, s_w_interval=(low, high))


def _averaging_advice(scatter: float, within: float) -> list[str]:
    """Advice to average repetitions where the relative `scatter` of single values exceeds `within`."""
    if scatter <= within:
        return []
    return [
        f"single values scatter by {100 * scatter:.2g} %, more than {100 * within:g} %: "
        f"average {math.ceil((scatter / within) ** 2)} repetitions"
    ]


def _determined_result(record: MeanRecord, fit: RelaxationFit, blank: RunningInResult) -> RunningInResult:
    """Numbers and sentence of a relaxation whose s_w is determined by the data."""
    unit, one, within, limit = record.unit, record.length, blank.within, fit.chi2_limit(INTERVAL_CONFIDENCE)
    interval, slid, reach = (
        fit.s_w_interval(limit),
        fit.slid_distance(within),
        fit.slid_distance_interval(within, limit),
    )
    count = None if one is None else [_count_repetitions(s, one) for s in (slid, *reach)]
    notes = [*blank.notes, *_averaging_advice(fit.scatter / (1.0 if record.absolute else abs(fit.final)), within)]
    notes += _misfit_notes(record, fit)
    goal = f"within {100 * within:g} % of its final value"
    if record.absolute:
        goal = f"unevenness (rms over the block/mean) within {within:g} of its final value"
    answer = replace(
        blank,
        s_w_interval=interval,
        slid_interval=reach,
        repetitions_interval=None if count is None else (count[1], count[2]),
    )
    if interval[0] == 0.0:
        most = f"{reach[1]:.3g} {unit}" if count is None else f"{count[2]} repetitions"
        says = f"only the first values differ for certain: {goal} after at most {most} (95 %)"
        notes.append(f"s_w is below {interval[1]:.3g} {unit} (95 %); values over shorter distances would show it")
        return replace(answer, says=says, notes=tuple(notes))
    if slid > record.end[-1]:
        notes.append(f"{slid:.3g} {unit} lie beyond the {record.end[-1]:.3g} {unit} of the data: an extrapolation")
    if count is None:
        says = f"{goal} after {slid:.3g} {unit} (95 %: {reach[0]:.3g} to {reach[1]:.3g})"
    else:
        says = f"{goal} after {count[0]} repetitions (95 %: {count[1]} to {count[2]})"
        says += f", {slid:.3g} m" if unit == "m" else ""
    return replace(
        answer,
        says=says,
        notes=tuple(notes),
        s_w=fit.s_w,
        s_w_error=fit.s_w_error,
        start=fit.start,
        final=fit.final,
        slid=slid,
        repetitions=None if count is None else int(count[0]),
    )


def _misfit_notes(record: MeanRecord, fit: RelaxationFit) -> list[str]:
    """Notes where the values are not a single exponential: s_w changes without the first values."""
    later = [RelaxationFit(drop_first(record, k)) for k in range(1, min(3, len(record.value) - MIN_FIT_VALUES) + 1)]
    ranges = [f.s_w_interval(f.chi2_limit(MISFIT_CONFIDENCE)) for f in later]
    if not record.simulated and all(low <= fit.s_w <= high for low, high in ranges):
        return []
    notes = ["the values are not a single exponential: the intervals are too narrow"]
    if record.simulated:
        notes = ["a simulation has no scatter: the intervals, from the residuals, show how well one exponential fits"]
    if later:
        fits = ", ".join(f"{f.s_w:.3g}" for f in later)
        first = f"1 to {len(later)} values" if len(later) > 1 else "value"
        notes.append(f"without the first {first} s_w = {fits} {record.unit}")
    return notes


def _count_repetitions(slid: float, length: float) -> float:
    """The number of whole repetitions that reach a slid distance."""
    return math.inf if slid == math.inf else math.ceil(slid / length - 1e-9)


def read_record(source, distance: float | None = None, of: str = "friction") -> MeanRecord:
    """The record of a result folder, by repetition, or of a CSV file.  Raises BadInput."""
    path = Path(source)
    if of not in RECORD_QUANTITIES:
        raise BadInput(f"--of: {of!r}; give {' or '.join(RECORD_QUANTITIES)}")
    if distance is not None and not 0 < distance < math.inf:
        raise BadInput(f"--distance: {distance:g}; give the metres slid in one repetition, > 0")
    if path.is_dir():
        if distance is not None:
            raise BadInput(f"--distance: {distance:g}; {path} contains its distance; leave --distance out")
        return _read_result_folder(path, of)
    if not path.is_file():
        raise BadInput(
            f"{path}: no such file or folder; give a result folder or a CSV file with columns {CSV_HEADER_WORDS}"
        )
    if of != "friction":
        raise BadInput(f"--of: {of}; {path} contains friction only; give a result folder")
    return _read_csv_file(path, distance)


def _read_result_folder(folder: Path, of: str) -> MeanRecord:
    import xarray as xr

    file = folder / "run.nc"
    if not file.is_file():
        raise BadInput(f"{folder}: no run.nc there; give a result folder of flashtemp run")
    names = ("slid", "sliding", "repetition", "friction", "pressure", "T_spot", "x")
    try:
        with xr.open_dataset(file, engine="h5netcdf") as ds:
            slid, sliding, repetition, friction, pressure, spot, x = (ds[k].values for k in names)
    except (OSError, KeyError) as fault:
        raise BadInput(
            f"{file}: not a result ({' '.join(str(fault).split())}); give a result of flashtemp run"
        ) from fault
    edge = [0.0]
    for centre in x:
        edge.append(2 * centre - edge[-1])
    width = np.diff(edge) / edge[-1]  # cell widths over the length of the block
    mean = pressure @ width
    on = (sliding == 1) & np.isfinite(friction) & (mean > 0)
    slid, repetition, friction, mean = slid[on], repetition[on], friction[on], mean[on]
    value = friction
    if of == "pressure":
        value = np.sqrt((pressure[on] / mean[:, None] - 1) ** 2 @ width)
    begin, end, means = [], [], []
    for r in np.unique(repetition):
        s, v = slid[repetition == r], value[repetition == r]
        if s[-1] > s[0]:
            begin.append(s[0])
            end.append(s[-1])
            means.append(np.trapezoid(v, s) / (s[-1] - s[0]))
    if not means:
        raise BadInput(f"{file}: contains no sliding; give a result folder of flashtemp run")
    expected = _implied_s_w(folder, float(np.mean(friction)), float(np.mean(mean)), float(np.mean(spot[on])))
    length = float(slid[-1]) / len(means)
    return MeanRecord(
        np.array(begin), np.array(end), np.array(means), length=length, of=of, absolute=of == "pressure",
        simulated=True, expected=expected,
    )  # fmt: skip


def _implied_s_w(folder: Path, mu: float, pressure: float, spot_degC: float) -> float | None:
    """s_w = 1/(k_n k mu) of the case of a folder (theory.md, eq. (25)); None unless its block on springs wears."""
    from flashtemp.model import case as cases
    from flashtemp.model.effect_laws import EffectLaws

    try:
        scene = cases.load_case(folder).scene
    except FlashtempError:
        return None
    if scene.stiffness is None:
        return None  # every pressure mode of an elastic block relaxes over a different length
    now = scene.law_context(scene.schedule.phases[0], 0.0)
    now = now._replace(x=0.5 * scene.length, local_pressure=pressure, friction=mu)
    laws = EffectLaws(scene)
    if laws("holder.compliance", 0.0, None, now):
        return None  # a tilting holder also has a different length for every pressure mode
    rate = laws("block.abrasion", 0.0, spot_degC + KELVIN, now)
    return pressure / (scene.stiffness * float(rate)) if rate > 0 else None


def _read_csv_file(path: Path, distance: float | None) -> MeanRecord:
    table = _read_columns(path)
    if len(table["mu"]) > MAX_CSV_ROWS:
        raise BadInput(f"{path}: mu: {len(table['mu'])} rows; give means over repetitions, at most {MAX_CSV_ROWS}")
    key = "repetition" if "repetition" in table else "slid_m"
    at, value, sigma = table[key], table["mu"], table.get("sigma")
    _require_all(path, key, at, np.diff(at, prepend=-1.0) > 0, "increase from row to row and be >= 0")
    if sigma is not None:
        _require_all(path, "sigma", sigma, sigma > 0, "be > 0, or leave the column out")
    if key == "slid_m":
        half = 0.0 if distance is None else 0.5 * distance
        _require_all(
            path, key, at, at >= half, f"be at least half of --distance {distance}: it is the middle of a repetition"
        )
        return MeanRecord(at - half, at + half, value, sigma, distance)
    _require_all(path, key, at, (at >= 1) & (at == np.round(at)), "count from 1 in whole numbers")
    one = distance or 1.0
    unit = "repetitions" if distance is None else "m"
    return MeanRecord(one * (at - 1), one * at, value, sigma, one, unit)


def _require_all(path: Path, column: str, values: np.ndarray, good: np.ndarray, must: str) -> None:
    if not np.all(good):
        k = int(np.argmin(good))
        raise BadInput(f"{path}: {column}: {values[k]:g} in row {k + 1}; it must {must}")


def _read_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file by name: repetition or slid distance (m), mu, and optionally sigma."""
    if not path.is_file():
        raise BadInput(
            f"SOURCE: file '{path.name}' not found in {path.parent}; give a CSV file with columns {CSV_HEADER_WORDS}"
        )
    table = read_table(path, str(path))
    if not table.has_header:
        raise BadInput(f"{path}: no column names; write the header {CSV_HEADER_WORDS}")
    known = {"repetition": REPETITION_COLUMN, "slid_m": SLID_COLUMN, "mu": FRICTION, "sigma": SIGMA_COLUMN}
    columns: dict[str, RequiredColumn] = {}
    for column in table.columns:
        name = "slid_m" if split_label(column.label, "m")[0] == "slid" else column.label
        if name not in known:
            raise BadInput(
                f"{path}: column '{shorten_text(name)}'{suggest_name(name, known)}; write the header {CSV_HEADER_WORDS}"
            )
        columns[name] = known[name]
    if "mu" not in columns or ("repetition" in columns) == ("slid_m" in columns) or len(columns) < len(table.columns):
        labels = ",".join(c.label for c in table.columns)
        raise BadInput(f"{path}: header '{shorten_text(labels)}'; write {CSV_HEADER_WORDS}")
    return dict(zip(columns, read_required_columns(table, list(columns.values())).T, strict=True))
