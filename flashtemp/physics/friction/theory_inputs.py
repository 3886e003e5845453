"""Build the friction theory from the keys of a case; derive heat in depth and remarks on extrapolation from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.errors import BadInput, suggest_name
from flashtemp.physics import interpolation
from flashtemp.physics.arrays import Value
from flashtemp.physics.friction import rheology, roughness_spectrum
from flashtemp.physics.friction.adhesive_shear import AdhesiveShear
from flashtemp.physics.friction.persson import PayneSoftening, PerssonTheory
from flashtemp.physics.quantities import KELVIN

NOTABLE_EXTRAPOLATION = 0.01  # fraction of viscoelastic friction from beyond the measured range that gives a remark
DEFAULT_WLF = (7.718, 116.6)  # C1 and C2 (K) of rubber A
DEPOSITS_PER_DECADE = 3.0  # heat sources per decade of depth
ENLARGEMENT_PRESSURES_PA = np.geomspace(1e3, 1e7, 17)  # pressures at which area enlargement is computed
SKEW_GRID_POINTS = 128  # points along a side of the roads on which skewness is solved
MACROASPERITY_SPEED_M_S = 0.1  # sliding speed for the modulus at macroasperities

COLE_COLE_UNITS = {"relaxed": "Pa", "unrelaxed": "Pa", "exponent": "1", "time": "s"}
SELF_AFFINE_UNITS = {"height": "m", "rolloff": "1/m", "hurst": "1", "lowest": "1/m"}


def build_theory(values: dict[str, Any], folder: Path, table: str) -> PerssonTheory:
    """The theory for the key `values` of a case's `table`; files are relative to `folder`.  Raises BadInput."""
    shear = None
    if values["shear_stress"] > 0:
        shear = AdhesiveShear(
            values["shear_stress"], values["shear_width"], values["shear_speed"], values["activation"]
        )
    payne = _read_payne(values, table) if values["payne_rest"] < 1.0 else None
    road = _read_road(values, folder, table)
    plain = PerssonTheory(
        _read_rubber(values, folder, table), road, values["gamma"], shear, values["saturation"], payne
    )
    skewed = values["flattened"], values["skewness_cutoff"]
    return replace(plain, enlarged=_area_enlargements(*skewed, values["work_of_adhesion"], plain))


def _read_payne(values: dict[str, Any], table: str) -> PayneSoftening:
    loss = {"loss_peak": values["payne_loss_peak"], "loss_rest": values["payne_loss_rest"]}
    try:
        return PayneSoftening(values["payne_rest"], values["payne_strain"], **loss)
    except BadInput as fault:
        raise BadInput(f"{table}.{fault}") from fault


def _read_rubber(values: dict[str, Any], folder: Path, table: str) -> rheology.Rubber:
    constants = values["wlf"]
    if constants is not None and (len(constants) != 2 or not all(map(_is_positive, constants))):
        raise BadInput(f"{table}.wlf: {constants!r}; give the two constants C1 and C2 (K), both > 0")
    if values["master_curve"] is None:
        for key in ("wlf", "shift"):
            if values[key] is not None:
                raise BadInput(f"{table}.{key}: belongs to a master_curve; give that too, or leave it out")
        name = values["rubber"]
        if name not in rheology.READY_RUBBERS:
            raise BadInput(_describe_unknown(f"{table}.rubber", name, rheology.READY_RUBBERS, "master_curve"))
        return replace(rheology.READY_RUBBERS[name], poisson=values["poisson"])
    from flashtemp.physics.friction import master_curve_files

    c1, c2 = constants or DEFAULT_WLF
    shift: rheology.WLF | rheology.MeasuredShift = rheology.WLF(c1, c2, values["reference"] + KELVIN)
    has_shift = bool(constants or values["shift"])
    if values["shift"] is not None:
        shift = master_curve_files.read_shift(values["shift"], folder, f"{table}.shift")
    given, key = values["master_curve"], f"{table}.master_curve"
    if isinstance(given, dict):
        return rheology.Rubber(_read_analytic_modulus(given, key), shift, values["poisson"], "given")
    curve = master_curve_files.read_master_curve(given, folder, key, shift if has_shift else None, values["poisson"])
    return rheology.Rubber(curve, shift, values["poisson"], "measured")


def _read_analytic_modulus(given: dict[str, Any], key: str) -> rheology.ColeCole | rheology.PronySeries:
    """A Cole-Cole curve, or a Prony series { relaxed, terms = [[E_i, tau_i], ...] }."""
    if set(given) == {"relaxed", "terms"}:
        terms = interpolation.read_rows(given["terms"], Path(), f"{key}.terms", 2)
        if terms.min() <= 0 or not _is_positive(given["relaxed"]):
            raise BadInput(f"{key}: {given!r}; give moduli (Pa) and times (s) > 0")
        return rheology.PronySeries(float(given["relaxed"]), *(tuple(column) for column in terms.T.tolist()))
    _require_keys(given, COLE_COLE_UNITS, key, "or { relaxed, terms = [[Pa, s], ...] }")
    if not (given["unrelaxed"] > given["relaxed"] and given["exponent"] <= 1):
        raise BadInput(f"{key}: {given!r}; give unrelaxed > relaxed and an exponent <= 1")
    return rheology.ColeCole(**{k: float(v) for k, v in given.items()})


def _require_keys(given: dict[str, Any], units: dict[str, str], key: str, otherwise: str) -> None:
    if set(given) != set(units) or not all(_is_positive(v) for v in given.values()):
        words = ", ".join(f"{k} = {unit}" for k, unit in units.items())
        raise BadInput(f"{key}: {given!r}; give {{ {words} }}, all > 0, {otherwise}")


def _is_positive(value: Value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < float("inf")


def _read_road(values: dict[str, Any], folder: Path, table: str) -> roughness_spectrum.RoughnessSpectrum:
    if values["spectrum"] is None:
        name = values["road"]
        if name not in roughness_spectrum.READY_ROADS:
            raise BadInput(_describe_unknown(f"{table}.road", name, roughness_spectrum.READY_ROADS, "spectrum"))
        road = roughness_spectrum.READY_ROADS[name]
    elif isinstance(given := values["spectrum"], dict):
        _require_keys(given, SELF_AFFINE_UNITS, f"{table}.spectrum", "a CSV file or rows of [1/m, m4]")
        if not (given["hurst"] < 1 and given["rolloff"] > given["lowest"]):
            raise BadInput(f"{table}.spectrum: {given!r}; give hurst < 1 and a rolloff above the lowest")
        height, rolloff, hurst, lowest = (given[k] for k in SELF_AFFINE_UNITS)
        road = roughness_spectrum.self_affine_spectrum(height, rolloff, hurst, lowest, slope=None, name="given")
    else:
        from flashtemp.physics.friction import measured_roughness

        points = measured_roughness.read_spectrum(values["spectrum"], folder, f"{table}.spectrum")
        road = roughness_spectrum.RoughnessSpectrum(points, points.q[0], points.q[-1], "measured")
    road = road if values["lowest"] is None else replace(road, q0=values["lowest"])
    if values["highest"] is not None:
        if not values["highest"] > road.q0:
            raise BadInput(f"{table}.highest: {values['highest']:g} 1/m is not above the lowest, {road.q0:.4g} 1/m")
        return replace(road, q1=values["highest"])
    try:
        return road.cut_at_slope(values["rms_slope"])
    except BadInput as fault:
        raise BadInput(f"{table}.{fault}") from fault


def _describe_unknown(key: str, name: str, ready: Collection[str], otherwise: str) -> str:
    return f"{key}: '{name}' is none of {', '.join(ready)}{suggest_name(name, ready)}; or give {otherwise}"


def _area_enlargements(flattened: float, cutoff: float, work: float, plain: PerssonTheory) -> tuple[Any, ...]:
    """Enlargements of the contact area by skewness of waves longer than `cutoff` (m) and by a work of adhesion."""
    modulus = macroasperity_modulus(plain)
    skewed = _skewness_of_waves(flattened, cutoff, modulus, plain.road) if flattened < 1.0 else ()
    return skewed + ((_cached_adhesion(work, replace(plain, payne=None)),) if work > 0.0 else ())


def _skewness_of_waves(
    flattened: float, cutoff: float, modulus: float, road: roughness_spectrum.RoughnessSpectrum
) -> tuple[Any, ...]:
    """Enlargement of the contact area of a road whose waves longer than `cutoff` (m) are skewed; 0: all waves."""
    shortest = 2 * np.pi / cutoff if cutoff > 0.0 else road.q1
    if shortest <= road.q0:  # the road has no such waves
        return ()
    if shortest >= road.q1:
        return (_cached_skewness(flattened, modulus, road),)
    return (replace(_cached_skewness(flattened, modulus, replace(road, q1=shortest)), cutoff=cutoff),)


@lru_cache(maxsize=32)
def _cached_skewness(flattened: float, modulus: float, road: roughness_spectrum.RoughnessSpectrum) -> Any:
    from flashtemp.physics.friction import skewness

    return skewness.skewness_enlargement(
        flattened, modulus, tuple(ENLARGEMENT_PRESSURES_PA.tolist()), SKEW_GRID_POINTS, road=road
    )


@lru_cache(maxsize=32)
def _cached_adhesion(work: float, plain: PerssonTheory) -> Any:
    from flashtemp.physics.friction import adhesion

    return adhesion.adhesion_enlargement(
        plain, MACROASPERITY_SPEED_M_S, 293.15, work, ENLARGEMENT_PRESSURES_PA, viscous=0.0
    )


def describe_assumptions(values: dict[str, Any]) -> list[str]:
    """Remarks on inputs that the case does not state, and on keys without effect."""
    remarks = []
    if values["master_curve"] is not None and values["wlf"] is None and values["shift"] is None:
        remarks += [
            f"no shift factor was given: the master curve is shifted by C1, C2 = {DEFAULT_WLF} K, those of rubber A"
        ]
    if values["payne_loss_peak"] is not None and values["payne_rest"] == 1.0:
        remarks += ["payne_loss_peak has no effect: payne_rest = 1 switches the softening off; give less than 1"]
    return remarks


def macroasperity_modulus(theory: PerssonTheory) -> float:
    """Contact modulus |E|/(1 - nu^2) (Pa) at the longest waves of the road in slow sliding at 20 degC."""
    E = theory.rubber.complex_modulus(theory.road.q0 * MACROASPERITY_SPEED_M_S, 293.15)
    return float(np.abs(E) / (1 - theory.rubber.poisson**2))


def heat_deposits(theory: PerssonTheory, v: float, T: float, p: float, min_depth: float) -> list[tuple[float, float]]:
    """Fractions of the friction heat released inside the rubber below `min_depth` (m), and their depths (m).

    The spectrum dmu/dq, whose heat decays over 1/(2q), at speed v (m/s), T (K) and p (Pa) is lumped into a few depths;
    theory.md, eqs. (6) and (7).
    """
    result = theory(v, T, p)
    share = result.density * result.weight / result.mu
    depth = 0.5 / result.q
    bin_of = np.floor(DEPOSITS_PER_DECADE * np.log10(depth / min_depth)).astype(int)
    out = []
    for k in np.unique(bin_of[bin_of >= 0]):
        in_bin = bin_of == k
        total = float(share[in_bin].sum())
        out.append((total, float(np.exp(np.sum(share[in_bin] * np.log(depth[in_bin])) / total))))
    return [(s, d) for s, d in out if s > 1e-6]


def describe_extrapolation(theory: PerssonTheory, speeds: Value, T: float, p: float) -> list[str]:
    """Remarks on friction from frequencies or wavenumbers beyond the measured range; speeds in m/s, T in K."""
    remarks = [line for v in speeds for line in _extrapolation_at_speed(theory, v, T, p)]
    return list(dict.fromkeys(remarks))


def _extrapolation_at_speed(theory: PerssonTheory, v: float, T: float, p: float) -> list[str]:
    result = theory(v, T, p)
    share = result.density * result.weight / np.maximum(result.viscous, 1e-300)
    low, high = theory.rubber.modulus.valid_range
    omega = result.q * v * theory.rubber.shift_factor(T)
    q_low, q_high = theory.road.law.valid_range
    cold, warm = theory.rubber.shift.valid_range
    remarks = []
    for part, outside, source in (
        (share[omega > high].sum(), f"above {high:.3g} rad/s", "the master curve"),
        (share[omega < low].sum(), f"below {low:.3g} rad/s", "the master curve"),
        (share[result.q > q_high * (1 + 1e-9)].sum(), f"above {q_high:.3g} 1/m", "the spectrum"),
        (share[result.q < q_low * (1 - 1e-9)].sum(), f"below {q_low:.3g} 1/m", "the spectrum"),
    ):
        if part > NOTABLE_EXTRAPOLATION:
            remarks.append(f"{100 * part:.0f} % of the viscoelastic friction comes from {outside}, beyond {source}")
    if not cold <= T <= warm:
        remarks.append(
            f"{T - KELVIN:.0f} degC lies beyond the shift factors ({cold - KELVIN:.0f} to {warm - KELVIN:.0f} degC)"
        )
    return remarks
