"""Tread block and tyre of a case: read the inputs, compute friction or side force, and report the result."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any, ClassVar

from flashtemp.display import DisplayMixin, DisplayTable, write_json
from flashtemp.errors import BadInput
from flashtemp.model.build import find_theory
from flashtemp.model.case import Case
from flashtemp.model.scene import ActiveEffect
from flashtemp.model.schema import COMMAND_TABLES
from flashtemp.physics.friction import cold_hot_law, theory_inputs
from flashtemp.physics.friction import tread_block as treads
from flashtemp.physics.friction import tyre as tyres
from flashtemp.physics.friction.flash_temperature import ContactSpots
from flashtemp.physics.friction.friction_curves import MAX_SPOT_FRACTION
from flashtemp.physics.friction.road_side import RoadSide
from flashtemp.physics.material import Material
from flashtemp.physics.quantities import KELVIN

MIN_SPEED_RATIO = 1e-3  # over the fastest sliding speed; slower sliding hardly contributes to the friction
MAXIMUM_MARKS = {
    "+": "still rising at the last slip angle", "<": "already falling at the first slip angle",
    "*": "at the only one of tyre.angles",
}  # fmt: skip
CARRIED_HEAT_WORDS = "heat carried from one revolution to the next"
ROAD_HEAT_WORDS = ", heat that flows into the road or is released by the adhesive part"
Watch = Callable[[int, int], Any]


@dataclass(frozen=True)
class RollingSetup:
    """Inputs from a case for its `table` "tread" or "tyre", whose values are in `values`.

    Friction theory (in `acting`), rubber, contact spots, nominal `pressure` in Pa and background temperature `T0` in K.
    """

    case: Case
    table: str
    values: dict[str, Any]
    acting: ActiveEffect
    rubber: Material
    T0: float
    pressure: float
    spots: ContactSpots

    @classmethod
    def from_case(cls, case: Case, table: str) -> RollingSetup:
        """Read a case.  Raises BadInput where it has no friction theory or no constant pressure."""
        if table not in case.values:
            given = {f"{table}.{k}": p.value for k, p in COMMAND_TABLES[table].items() if p.value is not None}
            case = case.with_values(given)
        scene, acting = find_theory(case)
        values, pressure = case.values[table], case["contact.pressure"]
        if not isinstance(pressure, (int, float)):
            raise BadInput(f"contact.pressure: {pressure!r}; a rolling {table} needs one number (Pa)")
        road = RoadSide(scene.road, _contact_conductance(case)) if values["road_heat"] else None
        spots = ContactSpots(scene.spot_diameter, values["fraction"], road)
        return cls(case, table, values, acting, scene.block, scene.ambient, pressure, spots)

    def build_law(self, fastest: float) -> cold_hot_law.ColdHotLaw:
        """The cold-hot law (theory.md, eq. (20)) up to twice the `fastest` speed (m/s), constant above."""
        return cold_hot_law.derive_law(
            self.acting.p.theory, self.rubber, self.spots, self.T0, self.pressure, 2.0 * fastest, self.values["memory"]
        )

    def list_remarks(self, fastest: float) -> list[str]:
        """Assumptions and limits of the result.  Raises BadInput where extrapolation is needed but not allowed."""
        remarks, theory = list(_conductance_remarks(self.case) if self.spots.road else ()), self.acting.p.theory
        phi = self.spots.contact_fraction(theory, min(1.0, fastest), self.T0, self.pressure)
        source = "given" if self.spots.fraction is not None else "from the theory, P(2 pi/D) at 1 m/s"
        remarks.append(
            f"contact fraction {phi:.2g} ({source}); contact.spot_fraction is for the heat of a block and not used here"
        )
        if self.spots.fraction is None and phi > MAX_SPOT_FRACTION:
            remarks.append(
                f"a contact fraction above {MAX_SPOT_FRACTION:g} hardly consists of separate spots, and the flash "
                f"temperature is low; {self.table}.fraction sets another fraction"
            )
        if self.case["friction.mu"] != 1.0 or self.acting.p.weight != 1.0:
            remarks.append(
                "friction is that of the theory alone: friction.mu and the weight of the effect are not used"
            )
        beyond = theory_inputs.describe_extrapolation(
            theory, (MIN_SPEED_RATIO * fastest, fastest), self.T0, self.pressure
        )
        if beyond and not self.acting.p.extrapolate:
            raise BadInput(f"{self.acting.name}.extrapolate: false, but {beyond[0]}; measure further, or allow it")
        return [*remarks, *self.acting.p.assumed, *beyond]

    def refuse_ringing(self, ringing: float) -> None:
        """Raise BadInput where a bristle on its spring oscillates too slowly in the footprint."""
        if ringing > treads.MAX_RINGING_RATIO:
            mass, table = self.values["mass"], self.table
            raise BadInput(
                f"{table}.mass: {mass:g} kg/m2: the bristle oscillates with a period of {ringing:.2g} of the contact "
                f"time, which distorts the friction; give a smaller {table}.mass or a larger {table}.stiffness"
            )


@dataclass(frozen=True, eq=False, repr=False)
class RollingStudy(DisplayMixin):
    """Base of results on rolling rubber: `result` for a `setup`, with `remarks` on assumptions and limits."""

    setup: RollingSetup
    result: Any
    remarks: tuple[str, ...]
    omissions: ClassVar[str]

    @property
    def not_modelled(self) -> str:
        """The effects that the model leaves out, as text."""
        return self.omissions if self.setup.spots.road else self.omissions + ROAD_HEAT_WORDS

    def as_dict(self) -> dict[str, Any]:
        """All numbers as plain data, as in the JSON file."""
        s = self.setup
        return self.result.as_dict() | {
            "spot_diameter_m": s.spots.diameter, "T0_degC": s.T0 - KELVIN, "pressure_Pa": s.pressure,
            "remarks": list(self.remarks), "not_modelled": self.not_modelled,
        }  # fmt: skip

    def save(self, folder: Path, out: Path) -> None:
        """Write the complete case, curves and numbers to `folder`, later renamed to `out`."""
        case, table = self.setup.case, self.setup.table
        (folder / "case.toml").write_text(case.toml(case.copy_files(folder)), encoding="utf-8")
        (folder / f"{table}.csv").write_text("\n".join(self.result.csv_rows()) + "\n", encoding="utf-8")
        write_json(self.as_dict() | {"out": str(out)}, folder / f"{table}.json")

    @abstractmethod
    def summary_lines(self) -> list[str]:
        """The result as lines of text."""

    def __str__(self) -> str:
        return "\n".join([*self.summary_lines(), *self._closing_lines()])

    def _closing_lines(self) -> list[str]:
        return [*(f"  remark: {r}" for r in self.remarks), f"  not modelled: {self.not_modelled}"]


class TreadPassage(RollingStudy):
    """Friction of a tread block along its footprint at several slips (`result`: RollingResult)."""

    result: treads.RollingResult
    omissions = f"the rest of the wheel, {CARRIED_HEAT_WORDS}"

    def summary_lines(self) -> list[str]:
        result, best = self.result.as_dict(), self.result.as_dict()["maximum"]
        head = "    slip   slides  of slip x l   at exit       mu   cold 0 .. hot 1   friction (law)  law off by"
        lines = [self._title_line(), head]
        for row in result["slips"]:
            way = "-" if isnan(row["from_cold_to_hot"]) else f"{row['from_cold_to_hot']:.2f}"
            lines.append(
                f"  {row['slip']:6.4g}  {1e3 * row['slid_m']:5.2f} mm  {1e3 * row['slip_distance_m']:6.2f} mm  "
                f"{row['speed_at_exit_m_s']:6.3g} m/s   {row['mu_at_exit']:6.4f}   {way:>8}       "
                f"  {row['friction']:.4f} ({row['friction_law']:.4f})   {100 * row['law_deviates']:4.1f} %"
            )
        where = f"{best['slip_over_D_per_l']:.2f} D/l"
        if best["at_edge"]:
            where = f"the {'largest' if best['at_last'] else 'smallest'} slip computed"
        highest = f"highest at slip {best['slip']:.3g}, {where}: {best['friction']:.4f}"
        return [*lines, f"  friction of the footprint is {highest}"]

    def _title_line(self) -> str:
        result, block = self.result, self.result.tread
        return (
            f"Tread block: {block.speed:g} m/s over {1e3 * block.footprint:g} mm ({1e3 * block.contact_time:.2f} ms), "
            f"{block.pressure / 1e6:g} MPa, {result.T0 - KELVIN:.0f} degC, "
            f"spots of {1e3 * result.spots.diameter:g} mm, r0 = {result.law.memory_text} mm"
        )

    def to_table(self) -> DisplayTable:
        head = ("slip", "slides, mm", "speed at exit, m/s", "mu at exit", "cold 0 .. hot 1", "friction", "with the law")
        rows = [
            (r["slip"], 1e3 * r["slid_m"], r["speed_at_exit_m_s"], r["mu_at_exit"], r["from_cold_to_hot"],
             r["friction"], r["friction_law"])
            for r in self.result.as_dict()["slips"]
        ]  # fmt: skip
        return DisplayTable(
            self._title_line(), rows, head, [self.summary_lines()[-1].strip(), *map(str.strip, self._closing_lines())]
        )


class TyreForces(RollingStudy):
    """Side force over slip angle at several loads, with the cold-hot law and its controls (`result`)."""

    result: tyres.CorneringResult
    omissions = (
        f"bending of the carcass, camber and drive, a pressure that varies in the footprint, {CARRIED_HEAT_WORDS}"
    )

    def summary_lines(self) -> list[str]:
        result = self.result
        lines = [self._title_line(), "  highest side force over load, at a slip angle:"]
        for name, peaks, fall in self._peak_rows():
            peaks_text = "   ".join(f"{p.value:.4f} at {p.at:.2g} deg{_end_mark(p)}" for p in peaks)
            lines.append(f"    {name:18s} {peaks_text}   " + ("" if fall is None else f"{fall:+.1f} %"))
        marks = {_end_mark(p) for peaks in result.peaks.values() for p in peaks}
        lines += [f"    {mark} {words}" for mark, words in MAXIMUM_MARKS.items() if mark in marks]
        for model in tyres.TYRE_MODELS:
            if (angle := result.rising_up_to_deg(model)) is not None and len(result.angles) > 1:
                lines.append(
                    f"  {model}: side force has no maximum up to {angle:g} deg, so its load dependence is unknown"
                )
            if result.has_peak_fall(model) and result.has_flat_controls(model):
                lines.append(f"  {model}: no control falls with load, so the flash temperature causes the fall")
        return lines

    def _title_line(self) -> str:
        result = self.result
        lengths = ", ".join(f"{1e3 * x:.0f}" for x in result.as_dict()["footprint_length_m"])
        return (
            f"Tyre: {result.tyre.speed:g} m/s, {result.tyre.pressure / 1e6:g} MPa, {result.T0 - KELVIN:.0f} degC, "
            f"r0 = {result.law.memory_text} mm; footprint of {1e3 * result.tyre.width:g} mm x {lengths} mm at "
            + ", ".join(f"{x:g}" for x in result.loads) + " N"
        )  # fmt: skip

    def _peak_rows(self):
        """Name, maxima and change with load (%) of every model and law."""
        for (model, law), peaks in self.result.peaks.items():
            name = f"{model}, {law}" if law == "law" else f"{model}, both {law}"
            fall = self.result.peak_fall(model, law)
            yield name, peaks, None if fall is None else -100 * fall + 0.0

    def to_table(self) -> DisplayTable:
        head = ("highest side force over load", *(f"{load:g} N" for load in self.result.loads), "change, %")
        rows = [
            (name, *(p.value for p in peaks), "no maximum" if fall is None else fall)
            for name, peaks, fall in self._peak_rows()
        ]
        return DisplayTable(self._title_line(), rows, head, [line.strip() for line in self._closing_lines()])


def _end_mark(peak: Any) -> str:
    """The mark of a maximum at one or both ends of the slip angles."""
    return "*" if peak.first and peak.last else "<" if peak.first else "+" if peak.last else ""


@dataclass(frozen=True)
class TreadPassageInput:
    """A tread block of a case, ready to compute."""

    setup: RollingSetup
    tread: treads.TreadBlock
    remarks: tuple[str, ...]

    @classmethod
    def from_case(cls, case: Case) -> TreadPassageInput:
        """Read the table [tread] of a case, or its defaults.  Raises BadInput."""
        setup = RollingSetup.from_case(case, "tread")
        v = setup.values
        block = treads.TreadBlock(v["speed"], v["footprint"], v["stiffness"], v["mass"], setup.pressure)
        setup.refuse_ringing(block.ringing_ratio)
        return cls(setup, block, tuple(setup.list_remarks(v["speed"] * max(v["slip"]))))

    def pass_footprint(self, watch: Watch | None = None) -> TreadPassage:
        """Compute the friction along the footprint at every slip.  Raises SolverFailure."""
        s, slips = self.setup, self.setup.values["slip"]
        law = s.build_law(s.values["speed"] * max(*slips, treads.SWEPT_SLIPS[-1]))
        result = treads.compute_rolling(
            self.tread, law, s.acting.p.theory, s.rubber, s.spots, s.T0, sorted(slips), watch
        )
        return TreadPassage(s, result, (*self.remarks, *_stick_slip_remarks(result)))


@dataclass(frozen=True)
class TyreForcesInput:
    """A tyre of a case, ready to compute."""

    setup: RollingSetup
    tyre: tyres.Tyre
    fastest: float
    remarks: tuple[str, ...]

    @classmethod
    def from_case(cls, case: Case) -> TyreForcesInput:
        """Read the table [tyre] of a case, or its defaults.  Raises BadInput."""
        setup = RollingSetup.from_case(case, "tyre")
        v = setup.values
        wheel = tyres.Tyre(v["speed"], v["width"], setup.pressure)
        setup.refuse_ringing(tyres.make_bristle(wheel, min(v["loads"]), v["stiffness"], v["mass"]).ringing_ratio)
        fastest = float(wheel.lateral_speed(max(v["angles"])))
        return cls(setup, wheel, fastest, tuple(setup.list_remarks(fastest)))

    @property
    def max_slip_angle(self) -> float:
        """Slip angle (deg) up to which a maximum is sought; beyond tyre.angles only with extrapolation allowed."""
        widest = max(self.setup.values["angles"])
        return max(widest, tyres.MAX_SLIP_ANGLE_DEG) if self.setup.acting.p.extrapolate else widest

    def compute_side_forces(self, watch: Watch | None = None) -> TyreForces:
        """Compute the side force at every load and slip angle.  Raises SolverFailure."""
        s, v = self.setup, self.setup.values
        law = s.build_law(float(self.tyre.lateral_speed(self.max_slip_angle)))
        result = tyres.compute_cornering(
            self.tyre, law, v["loads"], v["angles"], v["stiffness"], v["mass"], s.T0, watch, self.max_slip_angle
        )
        return TyreForces(s, result, (*self.remarks, *_control_remarks(result)))


def _contact_conductance(case: Case) -> float:
    """contact.alpha (W/m2K) if it is a number, otherwise infinity for perfect contact (theory.md, eq. (19))."""
    alpha = case["contact.alpha"]
    return float(alpha) if isinstance(alpha, (int, float)) else float("inf")


def _conductance_remarks(case: Case) -> list[str]:
    """A remark where the memory kernels cannot use the contact conductance of the case."""
    if case["contact.alpha"] in ("inf", float("inf")) or isinstance(case["contact.alpha"], (int, float)):
        return []
    return ["contact.alpha is not a single number: perfect contact of block and road is assumed"]


def _stick_slip_remarks(result: treads.RollingResult) -> list[str]:
    """Remarks on stick-slip of a tread block, and on the dependence of its friction on the number of steps."""
    remarks, slips = [], [f"{s:g}" for s in result.slips[result.has_chatter]]
    if slips:
        remarks.append(
            f"at slip {', '.join(slips)} the block sticks and slips, because friction falls with speed; its mean "
            "friction there depends on tread.mass"
        )
    if result.chatter_swept.any():
        low, high = treads.SWEPT_SLIPS[result.chatter_swept][[0, -1]]
        remarks.append(f"in the search for the maximum the block sticks and slips at slips {low:.2g} to {high:.2g}")
    if result.step_error > treads.STEP_DOUBLING_TOLERANCE:
        remarks.append(
            f"{len(result.path.time) - 1} steps in the footprint are few: doubling them changes the friction (law) "
            f"by up to {100 * result.step_error:.1f} %"
        )
    return remarks


def _control_remarks(result: tyres.CorneringResult) -> list[str]:
    """Remarks on the validity of the maxima of a tyre."""
    remarks = []
    if result.chatter:
        remarks.append("bristles stick and slip where friction falls with speed; the maxima depend on tyre.mass there")
    for model in tyres.TYRE_MODELS:
        if result.has_peak_fall(model) and not result.has_flat_controls(model):
            remarks.append(
                f"{model}: a control without flash temperature falls with load as well, so other causes contribute"
            )
    return remarks
