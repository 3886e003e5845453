"""The answers of results in sentences, from their JSON files: for the head of a page and for a card."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from flashtemp.display import format_count
from flashtemp.lab.live_state import finite_number
from flashtemp.lab.result_parts import number_text, percent_change, record_list, stored_number, text_list
from flashtemp.lab.workspace import escape_control

Data = Mapping[str, Any]


# --- comparison --------------------------------------------------------------------------------------------
def grade_comparison(data: Mapping[str, Any]) -> str:
    """How well the model explains the data: good, warning (as large as the noise, but not random) or error."""
    entries = [*record_list(data.get("recordings")), *record_list(data.get("forces"))]
    grades = [grade_entry(entry) for entry in entries]
    return next((g for g in ("error", "warning") if g in grades), "good" if grades else "error")


def grade_entry(entry: Mapping[str, Any]) -> str:
    """The grade of one recording or load-cell series, by the rule of the report."""
    from flashtemp.viz.html.comparison_report import CHI2_NEAR_NOISE

    if not stored_number(entry.get("chi2_per_dof")) <= CHI2_NEAR_NOISE:
        return "error"
    return "good" if _is_white(entry) else "warning"


def _is_white(entry: Mapping[str, Any]) -> bool:
    """Whether the difference is random; a load-cell series states only its correlation."""
    from flashtemp.comparison.compare import WHITE_NOISE_LIMIT_SDS

    if "white" in entry:
        return bool(entry["white"])
    found = entry.get("correlation")
    parts = [c.get("sigma") for c in found.values() if isinstance(c, dict)] if isinstance(found, dict) else []
    return all(abs(stored_number(s)) < WHITE_NOISE_LIMIT_SDS for s in parts)


def describe_comparison(data: Mapping[str, Any]) -> list[str]:
    """How well the model explains the data, in sentences, the most important first; [] where nothing is compared."""
    recordings, forces = record_list(data.get("recordings")), record_list(data.get("forces"))
    return [*_describe_recordings(recordings), *_describe_forces(forces)]


def _describe_recordings(recordings: list[dict[str, Any]]) -> list[str]:
    if not recordings:
        return []
    worst, n = find_worst(recordings), len(recordings)
    grades = [grade_entry(r) for r in recordings]
    size = f"{number_text(worst.get('rmse_K'))} K rms"
    all_of_them = "the recording" if n == 1 else f"all {n} recordings"
    if "error" in grades:
        n_missed = grades.count("error")
        which = (
            "the recording"
            if n == 1
            else f"any of the {n} recordings"
            if n_missed == n
            else f"{n_missed} of {n} recordings"
        )
        times = number_text(math.sqrt(max(stored_number(worst.get("chi2_per_dof")), 0.0)))
        name = escape_control(str(worst.get("file")))
        most = f"; at the largest, {peak}" if (peak := describe_peak(worst)) else ""
        return [f"The model does not explain {which}: it misses {name} by {size}, {times} times the noise{most}."]
    if "warning" in grades:
        return [f"The model misses {all_of_them} by no more than the noise ({size}), but the difference is not random."]
    return [f"The model explains {all_of_them}: the difference, {size} at the largest, is noise of the camera."]


def _describe_forces(forces: list[dict[str, Any]]) -> list[str]:
    missed = [f for f in forces if grade_entry(f) == "error"]
    if not missed:
        return ["The model explains the measured friction."] if forces else []
    worst = max(missed, key=lambda f: abs(stored_number(f.get("bias"))))
    bias = stored_number(worst.get("bias"))
    name, sign = escape_control(str(worst.get("file"))), "higher" if bias > 0 else "lower"
    which = f"{len(missed)} of {format_count(len(forces), 'load-cell file')}"
    return [f"Friction differs in {which}: in {name} it is measured {number_text(abs(bias))} {sign} than computed."]


def find_worst(recordings: list[dict[str, Any]]) -> dict[str, Any]:
    """The recording with the largest chi2/dof."""
    order = [(r, stored_number(r.get("chi2_per_dof"))) for r in recordings]
    return max(order, key=lambda pair: math.inf if math.isnan(pair[1]) else pair[1], default=({}, 0.0))[0]


def describe_peak(recording: Mapping[str, Any]) -> str:
    """The largest difference of a recording in words, "" where none is stored."""
    peak = recording.get("largest")
    if not isinstance(peak, dict):
        return ""
    size, u = stored_number(peak.get("K")), stored_number(peak.get("u"))
    names = [str(p.get("name")) for p in record_list(recording.get("points"))]
    place = f"x = {number_text(1e3 * u)} mm"
    if names:  # u counts the points
        place = f"point {names[int(u)]}" if 0 <= u < len(names) else "one point"
    sign = "hotter" if size > 0 else "colder"
    return escape_control(
        f"{number_text(abs(size))} K {sign} than computed at {place}, t = {number_text(peak.get('time'))} s"
    )


# --- run ---------------------------------------------------------------------------------------------------
def describe_run(data: Data) -> list[str]:
    """The highest temperature of a run, how much the block warms along its length, and how friction changes."""
    hottest, trailing = finite_number(data.get("T_max_degC")), finite_number(data.get("rise_trailing_K"))
    if hottest is None or trailing is None:
        return []
    places = {"leading": "at the leading edge", "middle": "in the middle", "trailing": "at the trailing edge"}
    rises = {words: finite_number(data.get(f"rise_{place}_K")) for place, words in places.items()}
    texts = [f"{rise:.1f} K {words}" for words, rise in rises.items() if rise is not None]
    parts = (", ".join(texts[:-1]), texts[-1])
    out = [
        f"The highest temperature is {number_text(hottest)} °C; the block warms by {' and '.join(filter(None, parts))}."
    ]
    friction = [v for v in _number_list(data.get("friction_per_repetition")) if math.isfinite(v)]
    if len(friction) > 1 and number_text(friction[0]) != number_text(friction[-1]):
        change = f"from {number_text(friction[0])} to {number_text(friction[-1])}"
        out.append(f"Friction changes {change} between the first and the last repetition.")
    return out


# --- studies -----------------------------------------------------------------------------------------------
def describe_verdict(data: Data) -> list[str]:
    """The sentences of a verdict as they are stored."""
    return [escape_control(text).replace("degC", "°C") for text in text_list(data.get("says"))]


def describe_watch(data: Data) -> list[str]:
    """What the data of a watched test suffice for, so far."""
    says = data.get("says")
    return [escape_control(says[:1].upper() + says[1:])] if isinstance(says, str) and says else []


def describe_plan(data: Data) -> list[str]:
    """How many effects planned data can tell apart, and which addition helps most."""
    effects = record_list(data.get("effects"))
    proposals = [*record_list(data.get("experiments")), *record_list(data.get("sensors"))]
    if not effects:
        return []
    head = f"These data can tell apart {sum(bool(e.get('separable')) for e in effects)} of {len(effects)} effects"
    best = max(proposals, key=lambda p: len(text_list(p.get("helps"))), default={})
    n_more = len(text_list(best.get("helps")))
    if not n_more:
        return [f"{head}; no single addition tells more apart."]
    return [f"{head}; measured {escape_control(str(best.get('words')))} as well, {n_more} more."]


def describe_sensitivity(data: Data) -> list[str]:
    """The conclusions of a sensitivity study."""
    texts = [escape_control(text).replace("degC", "°C") for text in text_list(data.get("conclusions"))]
    return [f"{text[:1].upper()}{text[1:]}." for text in texts]


def describe_friction(data: Data) -> list[str]:
    """Where friction is highest with and without the heating of the contact, and its trends."""
    table = data.get("maximum")
    tops = table if isinstance(table, dict) else {}
    parts = []
    for branch, words in (("hot", "with the heat of the contact"), ("cold", "without that heat")):
        top = tops.get(branch)
        if isinstance(top, dict):
            parts.append(f"{words}, {number_text(top.get('mu'))} at {number_text(top.get('speed'))} m/s")
        elif branch in tops:
            parts.append(f"{words}, no maximum at these speeds")
    head = [f"Highest friction: {'; '.join(parts)}."] if parts else []
    return [*head, *_describe_trends(data)]


def _describe_trends(data: Data) -> list[str]:
    """The trends of friction, each with what would reverse it."""
    found = [escape_control(str(s.get("sentence", ""))) for s in record_list(data.get("signs"))]
    return [f"Friction {text.removeprefix('mu ').replace('degC', '°C')}." for text in found if text]


def describe_area(data: Data) -> list[str]:
    """Up to which pressure the contact area is proportional to the load, and where it saturates."""
    linear, full = (number_text(data.get(k)) for k in ("linear_up_to_p_over_E", "saturated_from_p_over_E"))
    if "linear_up_to_p_over_E" not in data:
        return []
    share = number_text(100.0 * stored_number(data.get("area_there")))
    return [f"The contact area is proportional to the load up to p/E = {linear}, where {share} % are in contact; "
            f"90 % are in contact from p/E = {full}."]  # fmt: skip


def describe_loads(data: Data) -> list[str]:
    """How much friction changes with load, and which process does most of it."""
    changes, speeds = (_number_list(data.get(k)) for k in ("ln_change", "speed_m_s"))
    pressures = _number_list(data.get("pressure_Pa"))
    if not changes or not speeds or not pressures:
        return []
    n = max(range(min(len(changes), len(speeds))), key=lambda k: abs(changes[k]))
    words = data.get("words")
    cause = str(words.get(str(data.get("leading")), "")) if isinstance(words, dict) else ""
    low, high = (number_text(1e-6 * p) for p in (pressures[0], pressures[-1]))
    change = f"{percent_change(changes[n]):+.1f} % at {number_text(speeds[n])} m/s"
    why = f", mostly because {escape_control(cause)}" if cause else ""
    return [f"From {low} to {high} MPa friction changes by {change}{why}.", *_describe_trends(data)]


def describe_tread(data: Data) -> list[str]:
    """The highest friction of the footprint and the slip at which it is reached."""
    top = data.get("maximum")
    if not isinstance(top, dict):
        return []
    end = ", the largest computed" if top.get("at_last") else ", the smallest computed" if top.get("at_first") else ""
    slip, friction = number_text(top.get("slip")), number_text(top.get("friction"))
    return [f"Friction of the footprint is highest at a slip of {slip}{end}: {friction}."]


def describe_tyre(data: Data) -> list[str]:
    """How the highest side force changes with load, and whether only the flash temperature explains it."""
    maxima = [m for m in record_list(data.get("maxima")) if m.get("law") == "law" and m.get("model") == "brush"]
    if not maxima:
        return []
    falls, ends = data.get("fall"), data.get("no_maximum_up_to_deg")
    fall = stored_number(falls.get("brush")) if isinstance(falls, dict) else math.nan
    loads = f"{number_text(maxima[0].get('load_N'))} to {number_text(maxima[-1].get('load_N'))} N"
    sizes = f"{number_text(maxima[0].get('mu'))} to {number_text(maxima[-1].get('mu'))} of the load"
    if math.isfinite(fall):
        head = f"From {loads} the highest side force changes from {sizes} (brush model, {-100.0 * fall:+.1f} %)."
    else:
        angle = number_text(ends.get("brush")) if isinstance(ends, dict) else "–"
        head = f"From {loads} the side force has no maximum up to {angle}°; there it is {sizes} (brush model)."
    holds = data.get("controls_hold")
    return [head, *(["No control falls with load, so the flash temperature causes the fall."] if holds is True else [])]


def _number_list(value: Any) -> list[float]:
    return [stored_number(v) for v in value] if isinstance(value, list) else []


SENTENCES: dict[str, Callable[[Data], list[str]]] = {  # by the JSON file of a result
    "watch.json": describe_watch,
    "verdict.json": describe_verdict, "compare.json": describe_comparison, "plan.json": describe_plan,
    "sensitivity.json": describe_sensitivity, "friction.json": describe_friction, "area.json": describe_area,
    "loads.json": describe_loads, "tread.json": describe_tread, "tyre.json": describe_tyre,
    "summary.json": describe_run,
}  # fmt: skip
