"""Friction from spectrum and master curve: over speed, over load, in a tread block, under a tyre; and roads for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flashtemp.api.inputs import Count, Overrides, ignore_progress, resolve_case
from flashtemp.api.picture_faults import RERUN_ELSEWHERE_HINT, report_drawing_faults
from flashtemp.display import write_json
from flashtemp.errors import BadInput
from flashtemp.model import priors
from flashtemp.model.build import find_theory
from flashtemp.model.case import Case
from flashtemp.physics.friction.contact_map import SolvedContactMap
from flashtemp.runs.results.result_folder import optional_folder
from flashtemp.runs.studies import area_study, friction_study, friction_trends, load_dependence, rolling
from flashtemp.runs.studies import road_surface as roads
from flashtemp.runs.studies.area_study import AreaStudy
from flashtemp.runs.studies.friction_study import FrictionStudy
from flashtemp.runs.studies.load_dependence import DEFAULT_PRESSURES_PA, DEFAULT_SPEEDS_M_S, LoadDependence
from flashtemp.runs.studies.road_surface import RoadSpectrum, SelfAffineRoad
from flashtemp.runs.studies.rolling import TreadPassage, TyreForces


def friction(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    slowest: float = 1e-6,
    fastest: float = 10.0,
    out: str | Path | None = None,
) -> FrictionStudy:
    """Friction over speed (m/s) and temperature from a master curve and a power spectrum.

    `out`: folder for the case, curves, numbers and a picture.  Raises BadInput, SolverFailure.
    """
    friction_study.refuse_speeds(slowest, fastest)
    loaded = resolve_case(case, overrides)
    with optional_folder(out) as work:
        found = friction_study.study_friction(loaded, slowest, fastest)
        if work is not None and out is not None:
            found.save(work, Path(out))
            with report_drawing_faults(found, out or work, "friction.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import friction_curves as picture

                theme.save_figure(picture.draw(found.curves, loaded.title), work / "friction.png")
    return found


def compute_contact_area(
    case: str | Path | Case, overrides: Overrides | None = None, *, out: str | Path | None = None
) -> AreaStudy:
    """The area in contact over nominal pressure on a road: elastic A(p/E), its linear law, where it saturates.

    `out`: folder for the case, curve, numbers and a picture.  Raises BadInput.
    """
    loaded = resolve_case(case, overrides)
    with optional_folder(out) as work:
        found = area_study.study_contact_area(loaded)
        if work is not None and out is not None:
            from flashtemp.viz.studies import contact_area as picture

            found.save(work, Path(out))
            picture.draw(found).savefig(work / "area.png")
    return found


def loads(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    pressures: Sequence[float] = DEFAULT_PRESSURES_PA,
    speeds: Sequence[float] = DEFAULT_SPEEDS_M_S,
    skewness_cutoff: float | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    watch: Count = ignore_progress,
) -> LoadDependence:
    """Which process makes friction depend on the load: saturation, softening, skewness, adhesion or heating.

    Nominal `pressures` in Pa and `speeds` in m/s, both rising.  `skewness_cutoff`: shortest wave (m) that skewness
    flattens, 0 all waves; the case's own if not given.  `out`: folder for the case, curves, numbers and a picture.
    Raises BadInput, SolverFailure.
    """
    loaded = resolve_case(case, overrides)
    if skewness_cutoff is not None:
        loaded = loaded.with_values({f"{find_theory(loaded)[1].name}.skewness_cutoff": skewness_cutoff})
    load_dependence.refuse_values("--pressures", pressures, 2)
    load_dependence.refuse_values("--speeds", speeds, 1)
    with optional_folder(out) as work:
        found = load_dependence.attribute_load_dependence(loaded, pressures, speeds, workers, watch)
        turns = [
            s for s in friction_trends.find_trends(loaded, priors.find_uncertain_inputs(loaded)[0]) if s.over in "Tp"
        ]
        found = replace(found, signs=tuple(turns))
        if work is not None:
            (work / "case.toml").write_text(loaded.toml(loaded.copy_files(work)), encoding="utf-8")
            write_json(found.as_dict(), work / "loads.json")
            found.save(work / "loads.csv")
            with report_drawing_faults(found, out or work, "loads.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.studies import load_dependence as picture

                theme.save_figure(picture.draw(found), work / "loads.png")
    return found


def tread(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    watch: Count = ignore_progress,
) -> TreadPassage:
    """One tread block through its footprint: friction on its way from the cold to the hot branch, at several slips.

    `out`: folder for the case, paths, numbers and a picture.  Raises BadInput, SolverFailure.
    """
    asked = rolling.TreadPassageInput.from_case(resolve_case(case, overrides))
    with optional_folder(out) as work:
        answer = asked.pass_footprint(watch)
        if work is not None and out is not None:
            answer.save(work, Path(out))
            with report_drawing_faults(answer, out or work, "tread.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import tread as picture

                theme.save_figure(picture.draw(answer.result, asked.setup.case.title), work / "tread.png")
    return answer


def tyre(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    watch: Count = ignore_progress,
) -> TyreForces:
    """Side force of a tyre over slip angle at several loads, with the cold-hot law and with its controls.

    `out`: folder for the case, curves, numbers and a picture.  Raises BadInput, SolverFailure.
    """
    asked = rolling.TyreForcesInput.from_case(resolve_case(case, overrides))
    with optional_folder(out) as work:
        answer = asked.compute_side_forces(watch)
        if work is not None and out is not None:
            answer.save(work, Path(out))
            with report_drawing_faults(answer, out or work, "tyre.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import tyre as picture

                theme.save_figure(picture.draw(answer.result, asked.setup.case.title), work / "tyre.png")
    return answer


def spots(
    file: str | Path | None = None,
    *,
    cutoff: float,
    pressure: float = 1.5e5,
    modulus: float = 1.33e7,
    length: float | None = None,
    width: float | None = None,
    pixel: float = 1e-4,
    hurst: float = 0.85,
    rms: float = 3e-4,
    rolloff: float = 5e-3,
    seed: int = 1,
    out: str | Path | None = None,
) -> SolvedContactMap:
    """Which macroasperity regions of a road touch under a nominal `pressure`: a contact map.

    `cutoff` (m) is the shortest wavelength that counts, `modulus` E/(1 - nu^2) of the rubber, Pa.  `file` holds
    heights, with `length` and `width` (m) where it does not state them; without one a self-affine road is made of
    `pixel`, Hurst exponent, `rms` height, wavelength of `rolloff` (m) and `seed`.
    `out`: a .npz for resolved_spots.contact_map.  Raises BadInput.
    """
    if out is not None:
        _check_file_path(Path(out), ".npz")
        if Path(out).exists():
            raise BadInput(f"--out: {out} exists; choose another name")
    road = SelfAffineRoad(length, width, pixel, hurst, rms, rolloff, seed)
    found = roads.find_contact_regions(None if file is None else Path(file), road, cutoff, pressure, modulus)
    if out is not None:
        found.save(Path(out))
    return found


def spectrum(
    file: str | Path,
    *,
    profile: bool = False,
    highpass: float | None = None,
    pixel: float | None = None,
    out: str | Path | None = None,
) -> RoadSpectrum:
    """The power spectrum C(q) of a measured road: a height map, or a line where `profile` is set or the file says so.

    `highpass`: longest wavelength that counts, m; `pixel`: distance of bare heights, m.  `out`: a .csv for
    persson_friction.spectrum, with a picture beside it.  Raises BadInput.
    """
    if out is not None:
        _check_file_path(Path(out), ".csv")
        for path in (Path(out), Path(out).with_suffix(".png")):
            if path.exists():
                raise BadInput(f"--out: {path} exists; choose another name")
    found = roads.read_road_spectrum(Path(file), profile, highpass, pixel)
    if out is not None:
        found.save(Path(out))
        with report_drawing_faults(found, Path(out).parent, Path(out).with_suffix(".png").name, RERUN_ELSEWHERE_HINT):
            from flashtemp.viz import theme
            from flashtemp.viz.theory import spectrum as picture

            drawn = picture.draw(found.points, found.summary.law, found.file.name)
            theme.save_figure(drawn, Path(out).with_suffix(".png"))
    return found


def _check_file_path(out: Path, suffix: str) -> None:
    """BadInput where a file cannot go."""
    if out.suffix != suffix or not out.absolute().parent.is_dir():
        raise BadInput(f"--out: {out}; give a {suffix} file in a folder that exists")
