"""Friction theory from power spectrum and master curve: speed, load, tread block, tyre; and road surfaces."""

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
    """Compute friction over speed and temperature from a master curve and a power spectrum (Persson's theory).

    `slowest`, `fastest`: range of sliding speed, m/s.  `out`: folder for the case, curves, numbers and a picture.
    Raises BadInput, SolverFailure.
    """
    friction_study.refuse_speeds(slowest, fastest)
    loaded = resolve_case(case, overrides)
    with optional_folder(out) as work:
        result = friction_study.study_friction(loaded, slowest, fastest)
        if work is not None and out is not None:
            result.save(work, Path(out))
            with report_drawing_faults(result, out or work, "friction.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import friction_curves as picture

                theme.save_figure(picture.draw(result.curves, loaded.title), work / "friction.png")
    return result


def compute_contact_area(
    case: str | Path | Case, overrides: Overrides | None = None, *, out: str | Path | None = None
) -> AreaStudy:
    """Compute the contact area over nominal pressure on a road: elastic A(p/E), its linear law, and saturation.

    `out`: folder for the case, curve, numbers and a picture.  Raises BadInput.
    """
    loaded = resolve_case(case, overrides)
    with optional_folder(out) as work:
        result = area_study.study_contact_area(loaded)
        if work is not None and out is not None:
            from flashtemp.viz.studies import contact_area as picture

            result.save(work, Path(out))
            picture.draw(result).savefig(work / "area.png")
    return result


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
    """Find which process makes friction depend on load: saturation, softening, skewness, adhesion or heating.

    `pressures` (nominal, Pa) and `speeds` (m/s) are in ascending order.  `skewness_cutoff`: shortest wavelength (m)
    that skewness flattens, 0 for all wavelengths, the value of the case when not given.  `out`: folder for the case,
    curves, numbers and a picture.  `watch(done, total)` is called with the progress.
    Raises BadInput, SolverFailure.
    """
    loaded = resolve_case(case, overrides)
    if skewness_cutoff is not None:
        loaded = loaded.with_values({f"{find_theory(loaded)[1].name}.skewness_cutoff": skewness_cutoff})
    load_dependence.refuse_values("--pressures", pressures, 2)
    load_dependence.refuse_values("--speeds", speeds, 1)
    with optional_folder(out) as work:
        result = load_dependence.attribute_load_dependence(loaded, pressures, speeds, workers, watch)
        trends = friction_trends.find_trends(loaded, priors.find_uncertain_inputs(loaded)[0])
        result = replace(result, signs=tuple(trend for trend in trends if trend.over in "Tp"))
        if work is not None:
            (work / "case.toml").write_text(loaded.toml(loaded.copy_files(work)), encoding="utf-8")
            write_json(result.as_dict(), work / "loads.json")
            result.save(work / "loads.csv")
            with report_drawing_faults(result, out or work, "loads.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.studies import load_dependence as picture

                theme.save_figure(picture.draw(result), work / "loads.png")
    return result


def tread(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    watch: Count = ignore_progress,
) -> TreadPassage:
    """Compute the friction of one tread block along its footprint, from the cold to the hot branch, at several slips.

    `out`: folder for the case, friction paths, numbers and a picture.  `watch(done, total)` is called with the
    progress.  Raises BadInput, SolverFailure.
    """
    passage = rolling.TreadPassageInput.from_case(resolve_case(case, overrides))
    with optional_folder(out) as work:
        result = passage.pass_footprint(watch)
        if work is not None and out is not None:
            result.save(work, Path(out))
            with report_drawing_faults(result, out or work, "tread.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import tread as picture

                theme.save_figure(picture.draw(result.result, passage.setup.case.title), work / "tread.png")
    return result


def tyre(
    case: str | Path | Case,
    overrides: Overrides | None = None,
    *,
    out: str | Path | None = None,
    watch: Count = ignore_progress,
) -> TyreForces:
    """Compute the side force of a tyre over slip angle at several loads, with the cold-hot law and its controls.

    `out`: folder for the case, curves, numbers and a picture.  `watch(done, total)` is called with the progress.
    Raises BadInput, SolverFailure.
    """
    forces = rolling.TyreForcesInput.from_case(resolve_case(case, overrides))
    with optional_folder(out) as work:
        result = forces.compute_side_forces(watch)
        if work is not None and out is not None:
            result.save(work, Path(out))
            with report_drawing_faults(result, out or work, "tyre.png", RERUN_ELSEWHERE_HINT):
                from flashtemp.viz import theme
                from flashtemp.viz.theory import tyre as picture

                theme.save_figure(picture.draw(result.result, forces.setup.case.title), work / "tyre.png")
    return result


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
    """Compute which macroasperity regions of a road touch under a nominal `pressure` (Pa): a contact map.

    `cutoff`: shortest wavelength included, m; `modulus`: E/(1 - nu^2) of the rubber, Pa.  `file` contains heights,
    with `length` and `width` (m) where it does not state them.  Without a file, a self-affine road is generated from
    `pixel` (m), `hurst` exponent, `rms` height (m), `rolloff` wavelength (m) and `seed`.
    `out`: a .npz file for resolved_spots.contact_map.  Raises BadInput.
    """
    if out is not None:
        _check_file_path(Path(out), ".npz")
        if Path(out).exists():
            raise BadInput(f"--out: {out} exists; choose another name")
    road = SelfAffineRoad(length, width, pixel, hurst, rms, rolloff, seed)
    result = roads.find_contact_regions(None if file is None else Path(file), road, cutoff, pressure, modulus)
    if out is not None:
        result.save(Path(out))
    return result


def spectrum(
    file: str | Path,
    *,
    profile: bool = False,
    highpass: float | None = None,
    pixel: float | None = None,
    out: str | Path | None = None,
) -> RoadSpectrum:
    """Compute the power spectrum C(q), m^4, of a measured road from a height map or a line profile.

    `profile`: the file is a line profile; not needed where its header states so.  `highpass`: longest wavelength
    included, m.  `pixel`: spacing of the heights (m) of a file without coordinates.  `out`: a .csv file for
    persson_friction.spectrum; a picture is written next to it.  Raises BadInput.
    """
    if out is not None:
        _check_file_path(Path(out), ".csv")
        for path in (Path(out), Path(out).with_suffix(".png")):
            if path.exists():
                raise BadInput(f"--out: {path} exists; choose another name")
    result = roads.read_road_spectrum(Path(file), profile, highpass, pixel)
    if out is not None:
        result.save(Path(out))
        with report_drawing_faults(result, Path(out).parent, Path(out).with_suffix(".png").name, RERUN_ELSEWHERE_HINT):
            from flashtemp.viz import theme
            from flashtemp.viz.theory import spectrum as picture

            drawn = picture.draw(result.points, result.summary.law, result.file.name)
            theme.save_figure(drawn, Path(out).with_suffix(".png"))
    return result


def _check_file_path(out: Path, suffix: str) -> None:
    """Raise BadInput where a file with this suffix cannot be written."""
    if out.suffix != suffix or not out.absolute().parent.is_dir():
        raise BadInput(f"--out: {out}; give a {suffix} file in a folder that exists")
