"""Commands on rolling rubber: tread, one tread block through its footprint; tyre, side force over slip angle."""

from __future__ import annotations

from contextlib import contextmanager
from math import isnan
from pathlib import Path

from flashtemp.cli.terminal import DONE, Json, counter, emit, finite
from flashtemp.errors import BadInput
from flashtemp.physics.quantities import KELVIN

SLOW = 1e-3  # of the fastest sliding: slower friction hardly counts for what was measured
NOT_MODELLED = {
    "tread": "the rest of the wheel, heat carried from one revolution to the next, heat that flows into the road",
    "tyre": "the carcass, which bends (rigid here), camber and drive, a pressure that varies in the footprint, "
    "heat carried from one revolution to the next, heat that flows into the road",
}
MARKS = {
    "+": "still rising at the last of tyre.angles", "<": "already falling at the first of tyre.angles",
    "*": "at the only one of tyre.angles",
}  # fmt: skip


def tread(case: str, /, *overrides: str, out: Path | None = None, json: Json = False) -> int:
    """One tread block through its footprint: friction on its way from the cold to the hot branch, at several slips.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tread] describes block and footprint.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tread when not given.
    """
    from flashtemp.physics.friction import tread_block as treads
    from flashtemp.viz import tread as picture

    asked = _Asked(case, overrides, "tread")
    v = asked.values
    block = treads.Tread(v["speed"], v["footprint"], v["stiffness"], v["mass"], asked.pressure)
    _still("tread", v["mass"], block.ringing)
    remarks = asked.remarks(v["speed"] * max(v["slip"]))
    with asked.folder(out) as (work, folder), counter(asked.case.name) as watch:
        law = asked.law(v["speed"] * max(*v["slip"], treads.SWEPT[-1]))
        found = treads.roll(block, law, asked.theory, asked.rubber, asked.spots, asked.T0, sorted(v["slip"]), watch)
        remarks += _sticking(found)
        told = asked.save(work, folder, found, remarks)
        picture.draw(found, asked.case.title).savefig(work / "tread.png")
    emit(told, json, _tread_text(found, remarks, folder))
    return DONE


def tyre(case: str, /, *overrides: str, out: Path | None = None, json: Json = False) -> int:
    """Side force of a tyre over slip angle at several loads, with the cold-hot law and with its controls.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tyre] describes footprint and bristles.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tyre when not given.
    """
    from flashtemp.physics.friction import tyre as tyres
    from flashtemp.viz import tyre as picture

    asked = _Asked(case, overrides, "tyre")
    v = asked.values
    wheel = tyres.Tyre(v["speed"], v["width"], asked.pressure)
    _still("tyre", v["mass"], tyres.bristle(wheel, min(v["loads"]), v["stiffness"], v["mass"]).ringing)
    fastest = float(wheel.pull(max(v["angles"])))
    remarks = asked.remarks(fastest)
    with asked.folder(out) as (work, folder), counter(asked.case.name) as watch:
        law = asked.law(fastest)
        found = tyres.corner(wheel, law, v["loads"], v["angles"], v["stiffness"], v["mass"], asked.T0, watch)
        remarks += _doubts(found)
        told = asked.save(work, folder, found, remarks)
        picture.draw(found, asked.case.title).savefig(work / "tyre.png")
    emit(told, json, _tyre_text(found, remarks, folder))
    return DONE


class _Asked:
    """What both commands read from a case: theory, rubber, spots, pressure Pa, background T0 K.  Raises BadInput."""

    def __init__(self, path: str, overrides, table: str):
        from flashtemp.model.build import theory_of
        from flashtemp.model.case import load
        from flashtemp.model.schema import APART
        from flashtemp.physics.friction.flash_temperature import Spots

        self.case, self.table = load(path, list(overrides)), table
        if table not in self.case.values:
            given = {f"{table}.{k}": p.value for k, p in APART[table].items() if p.value is not None}
            self.case = self.case.with_values(given)
        scene, acting = theory_of(self.case)
        self.acting, self.theory, self.rubber, self.T0 = acting, acting.p.theory, scene.block, scene.ambient
        self.values = self.case.values[table]
        self.pressure = self.case["contact.pressure"]
        if not isinstance(self.pressure, (int, float)):
            raise BadInput(f"contact.pressure: {self.pressure!r}; a rolling {table} needs one number (Pa)")
        self.spots = Spots(scene.spot_diameter, self.values["fraction"])

    def law(self, fastest: float):
        """The cold-hot law up to twice the speed (m/s) that pulls hardest; faster rubber has the friction there."""
        from flashtemp.physics.friction import cold_hot_law

        memory = self.values["memory"]
        return cold_hot_law.law(self.theory, self.rubber, self.spots, self.T0, self.pressure, 2.0 * fastest, memory)

    def remarks(self, fastest: float) -> list[str]:
        """What a user should know before believing the result; BadInput where the case allows no extrapolation."""
        from flashtemp.physics.friction import theory_inputs
        from flashtemp.physics.friction.friction_curves import USUAL

        said = []
        phi = self.spots.covered(self.theory, min(1.0, fastest), self.T0, self.pressure)
        whose = "given" if self.spots.fraction is not None else "by theory, P(2 pi/D) at 1 m/s"
        said.append(
            f"contact fraction {phi:.2g} ({whose}); contact.spot_fraction is for the block's heat and not used here"
        )
        if self.spots.fraction is None and phi > USUAL:
            said.append(
                f"more than {USUAL:g} of the area in contact are hardly spots: the flash is spread thin; "
                f"{self.table}.fraction sets another fraction"
            )
        if self.case["friction.mu"] != 1.0 or self.acting.p.weight != 1.0:
            said.append("friction is the theory's alone: friction.mu and the weight of the effect are not used here")
        beyond = theory_inputs.beyond(self.theory, (SLOW * fastest, fastest), self.T0, self.pressure)
        if beyond and not self.acting.p.extrapolate:
            raise BadInput(f"{self.acting.name}.extrapolate: false, but {beyond[0]}; measure further, or allow it")
        return said + self.acting.p.assumed + beyond

    @contextmanager
    def folder(self, out: Path | None):
        """A new folder, whole or absent: where to write, and its name at the end."""
        from flashtemp.runs.folders import free_name, whole

        final = out or free_name(Path("results") / f"{self.case.name}-{self.table}")
        with whole(final) as work:
            yield work, final

    def save(self, work: Path, final: Path, found, remarks: list[str]) -> dict:
        """Write the effective case, curves and numbers; returns the numbers."""
        import json

        (work / "case.toml").write_text(self.case.toml(self.case.copy_files(work)), encoding="utf-8")
        (work / f"{self.table}.csv").write_text("\n".join(found.rows()) + "\n", encoding="utf-8")
        told = found.as_dict() | {
            "spot_diameter_m": self.spots.diameter, "T0_degC": self.T0 - KELVIN, "pressure_Pa": self.pressure,
            "remarks": remarks, "not_modelled": NOT_MODELLED[self.table], "out": str(final),
        }  # fmt: skip
        (work / f"{self.table}.json").write_text(json.dumps(finite(told), indent=2) + "\n", encoding="utf-8")
        return told


def _still(table: str, mass: float, ringing: float) -> None:
    """Refuses a mass (kg/m2) that rings for long in the footprint.  Raises BadInput."""
    from flashtemp.physics.friction.tread_block import RINGING

    if ringing > RINGING:
        raise BadInput(
            f"{table}.mass: {mass:g} kg/m2: mass and spring ring with a period of {ringing:.2g} of the contact time, "
            f"which looks like friction; give a smaller {table}.mass or a larger {table}.stiffness"
        )


def _sticking(found) -> list[str]:
    """Where a tread block sticks and slips, and whether its friction depends on the steps."""
    from flashtemp.physics.friction.tread_block import SETTLED, SWEPT

    said, slips = [], [f"{s:g}" for s in found.slips[found.chatter]]
    if slips:
        said.append(
            f"at slip {', '.join(slips)} the block sticks and slips, for friction falls with speed; its mean there "
            "depends on tread.mass"
        )
    if found.rough.any():
        low, high = SWEPT[found.rough][[0, -1]]
        said.append(f"the block sticks and slips at slips from {low:.2g} to {high:.2g} of those tried for the maximum")
    if found.moved > SETTLED:
        said.append(
            f"{len(found.path.time) - 1} steps through the footprint are few: twice as many change the friction (law) "
            f"by up to {100 * found.moved:.1f} %"
        )
    return said


def _doubts(found) -> list[str]:
    """What stands against the maxima of a tyre."""
    from flashtemp.physics.friction.tyre import MODELS

    said = []
    if found.chatter:
        said.append("bristles stick and slip where friction falls with speed; the maxima depend on tyre.mass there")
    for model in MODELS:
        if found.falls(model) and not found.sound(model):
            said.append(
                f"{model}: a control without flash temperature falls with load as well: the fall is not its work alone"
            )
    return said


def _tread_text(found, remarks: list[str], folder: Path) -> str:
    told = found.as_dict()
    block, best = found.tread, told["maximum"]
    lines = [
        f"Tread block: {block.speed:g} m/s over {1e3 * block.footprint:g} mm ({1e3 * block.contact_time:.2f} ms), "
        f"{block.pressure / 1e6:g} MPa, {found.T0 - KELVIN:.0f} degC, spots of {1e3 * found.spots.diameter:g} mm, "
        f"r0 = {1e3 * found.law.r0:g} mm",
        "    slip   slides  of slip x l   at exit       mu   cold 0 .. hot 1   friction (law)  law off by",
    ]
    for row in told["slips"]:
        way = "-" if isnan(row["from_cold_to_hot"]) else f"{row['from_cold_to_hot']:.2f}"
        lines.append(
            f"  {row['slip']:6.4g}  {1e3 * row['slid_m']:5.2f} mm  {1e3 * row['slip_distance_m']:6.2f} mm  "
            f"{row['speed_at_exit_m_s']:6.3g} m/s   {row['mu_at_exit']:6.4f}   {way:>8}       "
            f"  {row['friction']:.4f} ({row['friction_law']:.4f})   {100 * row['law_deviates']:4.1f} %"
        )
    where = f"{best['slip_over_D_per_l']:.2f} D/l"
    if best["at_edge"]:
        where = f"the {'largest' if best['at_last'] else 'smallest'} that was tried"
    lines.append(f"  friction of the footprint is highest at slip {best['slip']:.3g}, {where}: {best['friction']:.4f}")
    return "\n".join([*lines, *_last("tread", remarks, folder)])


def _tyre_text(found, remarks: list[str], folder: Path) -> str:
    from flashtemp.physics.friction.tyre import MODELS

    told = found.as_dict()
    loads = found.loads
    lines = [
        f"Tyre: {found.tyre.speed:g} m/s, {found.tyre.pressure / 1e6:g} MPa, {found.T0 - KELVIN:.0f} degC, "
        f"r0 = {1e3 * found.law.r0:g} mm; footprint of {1e3 * found.tyre.width:g} mm x "
        + ", ".join(f"{1e3 * x:.0f}" for x in told["footprint_length_m"]) + " mm at "
        + ", ".join(f"{x:g}" for x in loads) + " N",
        "  highest side force over load, at a slip angle:",
    ]  # fmt: skip
    for (model, law), peaks in found.peaks.items():
        name = f"{model}, {law}" if law == "law" else f"{model}, both {law}"
        told_peaks = "   ".join(f"{p.value:.4f} at {p.at:.2g} deg{_mark(p)}" for p in peaks)
        lines.append(f"    {name:18s} {told_peaks}   {-100 * found.fall(model, law) + 0.0:+.1f} %")
    marks = {_mark(p) for peaks in found.peaks.values() for p in peaks}
    lines += [f"    {mark} {words}" for mark, words in MARKS.items() if mark in marks]
    for model in MODELS:
        if found.falls(model) and found.sound(model):
            lines.append(f"  {model}: no control falls with load: what falls is the work of the flash temperature")
    return "\n".join([*lines, *_last("tyre", remarks, folder)])


def _mark(peak) -> str:
    """The sign of a maximum that lies at an end of the slip angles, or at both."""
    return "*" if peak.first and peak.last else "<" if peak.first else "+" if peak.last else ""


def _last(table: str, remarks: list[str], folder: Path) -> list[str]:
    return [*(f"  remark: {r}" for r in remarks), f"  not modelled: {NOT_MODELLED[table]}", f"  results in {folder}/"]
