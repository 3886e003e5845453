"""HTML reports of studies from the files in their result folders: sweep, sensitivity, and plan of a campaign."""

from __future__ import annotations

import itertools
import json
import math
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flashtemp.display import atomic_write, format_count
from flashtemp.errors import BadInput, FlashtempError, describe_exception
from flashtemp.model.case import load_case
from flashtemp.physics import safe_hdf5
from flashtemp.viz.html import page, title_page
from flashtemp.viz.html.page import ReportSubject, Section
from flashtemp.viz.key_labels import describe_key
from flashtemp.viz.number_format import effect_label, format_number, unit_suffix

MAX_JSON_BYTES = 64 * 2**20
MAX_ROWS, MAX_EFFECTS_NAMED = 200, 6
SWEEP_METHOD = "Every combination of the swept values is one simulation of the case with those values."
LINEAR_METHOD = (
    "The case is simulated once with its sensitivities to all inputs. "
    "The standard deviations of the inputs are propagated linearly."
)
SAMPLE_METHOD = (
    "The case is simulated at values of the inputs from a Latin hypercube with their standard deviations; a polynomial "
    "fitted to these runs gives the fractions of the variance."
)
PLAN_METHOD = (
    "The sensitivities of all planned measurements to every candidate effect, to the free keys and to the camera are "
    "computed with the stated case. An effect can be distinguished if its signal at typical strength exceeds 5 "
    "standard errors with everything else free."
)
OUTPUT_WORDS = {
    "T_spot_L": "temperature of the contact spots at the trailing edge",
    "T_spot_max": "highest temperature of the contact spots at the end",
    "T_block_L": "temperature of the block's surface at the trailing edge",
    "mu": "friction coefficient of the last repetition",
}
MAIN_OUTPUTS = ("T_spot_L", "T_block_L", "mu")
STUDY_TERMS = {
    "sweep": (
        ("Temperature rise", "Temperature above that of the surroundings, on the block's surface averaged across y."),
        ("Contact spots", "The parts of the block's face that touch the road."),
    ),
    "sensitivity": (
        ("95 % band", "The range that holds the true value with a probability of 95 %, if the inputs are as uncertain "
         "as the table states and the model is right."),
        ("Change per sd", "Change of the number when the input grows by one standard deviation."),
        ("First order, total", "Fraction of the variance that an input causes alone, and together with the others."),
    ),
    "plan": (
        ("Signal alone", "Signal-to-noise ratio of the effect at its typical strength, if all else were known."),
        ("With all others free", "What is left of it when every other effect, free key and camera error may imitate "
         "it. From 5 on, the effect can be distinguished."),
        ("Detectable at 5 sigma", "The strength at which what is left would be 5."),
        ("Nearest rival", "The effect with the most similar signature, and the correlation of both."),
    ),
}  # fmt: skip


def _write(text: str, folder: Path) -> Path:
    path = folder / "report.html"
    with atomic_write(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    return path


@contextmanager
def _refuse_damaged(file: Path) -> Iterator[None]:
    """Context manager: whatever a damaged file causes becomes BadInput."""
    try:
        yield
    except (FlashtempError, OSError):
        raise
    except Exception as fault:
        raise BadInput(f"{file}: damaged ({describe_exception(fault)}); run the study again") from fault


def _read_json(file: Path) -> dict[str, Any]:
    """A JSON object.  Raises BadInput."""
    with _refuse_damaged(file):
        if file.stat().st_size > MAX_JSON_BYTES:
            raise BadInput(f"{file}: larger than {MAX_JSON_BYTES // 2**20} MiB; run the study again")
        found = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(found, dict):
            raise BadInput(f"{file}: not a JSON object; run the study again")
        return found


def _stored_picture(file: Path, alt: str, caption: str) -> list[str]:
    """A picture of the result folder; a sentence where there is none."""
    if not (data := page.read_png(file)):
        return [page.paragraph(f"The result folder has no picture {file.name}.", "small")]
    return [page.embed_png(data, alt, caption)]


def _answer(*sentences: str) -> list[str]:
    return ['<div class="verdict">', *(page.paragraph(text) for text in sentences), "</div>"]


def _terms(kind: str) -> Section:
    return Section("reading", "Terms", [page.term_list(STUDY_TERMS[kind])])


# --- sweep ------------------------------------------------------------------------------------------------------
def write_sweep_report(folder: Path, trust: bool = False) -> Path:
    """Write the report of a sweep into its result folder; returns its path.  Raises BadInput."""
    import xarray as xr

    from flashtemp.viz.studies import sweep as picture

    file, case = folder / "sweep.nc", load_case(folder / "case.toml", trust=trust)
    with _refuse_damaged(file):
        safe_hdf5.check_hdf5_file(file, lambda name: False, lambda *about: None)  # no links into other files
        data = xr.load_dataset(file, engine="h5netcdf")
        keys = [str(d) for d in data.T_max_degC.dims]
        points = [dict(zip(keys, p, strict=True)) for p in itertools.product(*(data[k].values.tolist() for k in keys))]
        names = " and ".join(describe_key(key).words for key in keys)
        answer, failed = _summarise_sweep(data.T_max_degC.values.ravel(), points)
        caption = "Temperature of the contact spots and temperature rises at the end of the last repetition" + (
            ", and two numbers over both keys." if len(keys) > 1 else "."
        )
        sections = [
            Section(
                "picture", f"Temperatures over {names}", [page.embed_figure(picture.draw(data), answer[0], caption)]
            ),
            Section("numbers", "Numbers of every combination", _sweep_tables(data, keys, points)),
            *([Section("failed", "Failed simulations", [page.paragraph(failed)])] if failed else []),
            _terms("sweep"),
        ]
    words = [f"{key}={','.join(map(str, data[key].values.tolist()))}" for key in keys]
    command = shlex.join(["flashtemp", "sweep", str(folder / "case.toml"), *words])
    files = ("case.toml", "sweep.nc", *case.named_files().values())
    subject = title_page.describe_study(case, command, points, SWEEP_METHOD, {n: folder / n for n in files}, file)
    title = f"{case.title}: sweep of {names}"
    return _write(page.render_report(title, _answer(*answer), subject, sections), folder)


def _summarise_sweep(hottest: np.ndarray, points: Sequence[dict[str, Any]]) -> tuple[list[str], str]:
    """The hottest and the coolest combination in a sentence, and one on those that failed."""
    known = np.isfinite(hottest)
    missing = [_describe_point(p) for p, is_known in zip(points, known, strict=True) if not is_known]
    shown = "; ".join(missing[:MAX_EFFECTS_NAMED]) + ("; ..." if len(missing) > MAX_EFFECTS_NAMED else "")
    failed = f"{format_count(len(missing), 'simulation')} failed, with the reason in sweep.csv: {shown}."
    if not known.any():
        return [f"All {len(points)} simulations failed."], failed
    ends = [int(np.nanargmin(hottest)), int(np.nanargmax(hottest))]
    low, high = (f"{format_number(hottest[k])} °C at {_describe_point(points[k])}" for k in ends)
    words = f"Of {len(points)} combinations, the highest temperature is between {low} and {high}."
    return [words], failed if missing else ""


def _describe_point(point: dict[str, Any]) -> str:
    return ", ".join(describe_key(key).describe_value(value) for key, value in point.items())


def _sweep_tables(data: Any, keys: Sequence[str], points: Sequence[dict[str, Any]]) -> list[str]:
    """One row per combination: the swept values, temperatures, rises, friction and wear."""
    columns = {
        "highest temperature (°C)": data.T_max_degC.values,
        "rise at the leading edge (K)": data.rise_leading_K.values,
        "rise in the middle (K)": data.rise_middle_K.values,
        "rise at the trailing edge (K)": data.rise_trailing_K.values,
        "friction, last repetition (–)": data.friction.isel(repetition=-1).values,
    }
    if np.nanmax(data.worn_mean_m.values, initial=0.0) > 0.0:
        columns["mean worn depth (µm)"] = 1e6 * data.worn_mean_m.values
    head = [describe_key(key).label for key in keys] + list(columns)
    rows = [
        [describe_key(key).format_value(value) for key, value in point.items()]
        + [format_number(column.ravel()[k]) for column in columns.values()]
        for k, point in enumerate(points[:MAX_ROWS])
    ]
    out = [page.table(head, rows)]
    if len(points) > MAX_ROWS:
        words = f"The first {MAX_ROWS} of {len(points)} combinations; sweep.csv has all of them."
        out.append(page.paragraph(words, "small"))
    return out


# --- sensitivity ------------------------------------------------------------------------------------------------
def write_sensitivity_report(folder: Path, trust: bool = False) -> Path:
    """Write the report of a sensitivity study into its result folder; returns its path.  Raises BadInput."""
    file, case = folder / "sensitivity.json", load_case(folder / "case.toml", trust=trust)
    data = _read_json(file)
    with _refuse_damaged(file):
        numbers, inputs = dict(data["numbers"]), list(data["inputs"])
        answer = [_describe_output(name, numbers[name], inputs) for name in MAIN_OUTPUTS if name in numbers]
        cautions = [str(text) for text in data.get("conclusions", []) if "95 % band" not in str(text)]
        sections = [
            Section("predictions", "Predicted numbers", [_output_table(numbers, inputs)]),
            Section("inputs", "Uncertain inputs", [_input_table(inputs), *_describe_fixed_inputs(data)]),
            Section("effects", "Change by each input", [
                *_stored_picture(folder / "sensitivity.png", "Bars of the change by each input; the table has the "
                                 "numbers.", "Change of three numbers by +1.96 standard deviations of each input."),
                *(_effect_table(numbers[name], name, inputs) for name in MAIN_OUTPUTS if name in numbers),
            ]),
            Section("profile", "Temperature along the block", _stored_picture(
                folder / "profile.png", "Temperature along the block with its 95 % band.",
                "Temperature at the end of the last repetition, with its 95 % band.",
            )),
            *([Section("cautions", "Remarks", [page.paragraph(f"{t[:1].upper()}{t[1:]}.") for t in cautions])]
              if cautions else []),
            _terms("sensitivity"),
        ]  # fmt: skip
        keys = [str(i["key"]) for i in inputs]
        is_linear = data.get("mode") == "linear"
    how = ["--linear"] if is_linear and not data.get("check") else []
    command = shlex.join(["flashtemp", "sensitivity", str(folder / "case.toml"), *keys, *how])
    files = ("case.toml", "sensitivity.json", "run.nc", *case.named_files().values())
    method = LINEAR_METHOD if is_linear else SAMPLE_METHOD
    subject = title_page.describe_study(case, command, [{}], method, {n: folder / n for n in files}, file)
    title = f"{case.title}: uncertainty of the prediction"
    return _write(page.render_report(title, _answer(*answer), subject, sections), folder)


def _output_words(name: str, number: dict[str, Any]) -> str:
    return OUTPUT_WORDS.get(name, str(number.get("words", name)))


def _unit(number: dict[str, Any], difference: bool = False) -> str:
    unit = str(number.get("unit", "1"))
    return unit_suffix("K" if difference and unit == "degC" else unit)


def _leading_input(number: dict[str, Any], inputs: Sequence[dict[str, Any]]) -> tuple[str, float]:
    """The input with the largest fraction of the variance, in words, and that fraction."""
    total = {str(i["key"]): float(number["total"][i["key"]]) for i in inputs}
    key = max(total, key=total.__getitem__, default="")
    return (describe_key(key).words, total[key]) if key else ("", 0.0)


def _describe_output(name: str, number: dict[str, Any], inputs: Sequence[dict[str, Any]]) -> str:
    """A number with its 95 % band, and the input that decides it."""
    low, high = (format_number(v) for v in number["band95"])
    words, fraction = _leading_input(number, inputs)
    why = f"; {format_number(100 * fraction)} % of its variance is from the {words}" if fraction > 0.0 else ""
    what, unit = _output_words(name, number), _unit(number)
    return f"The {what} is {format_number(number['value'])}{unit}, 95 % band {low} to {high}{unit}{why}."


def _output_table(numbers: dict[str, Any], inputs: Sequence[dict[str, Any]]) -> str:
    rows = []
    for name, n in numbers.items():
        words, fraction = _leading_input(n, inputs)
        unit = _unit(n).strip() or "–"
        rows.append([
            _output_words(name, n), unit, *(format_number(v) for v in (n["value"], n["sd"], *n["band95"])),
            f"{words}, {format_number(100 * fraction)} %" if fraction > 0.0 else "none",
        ])  # fmt: skip
    return page.table(["number", "unit", "value", "sd", "95 % from", "to", "largest part of the variance"], rows)


def _input_table(inputs: Sequence[dict[str, Any]]) -> str:
    rows = []
    for i in inputs:
        label = describe_key(str(i["key"]), str(i.get("unit", "1")))
        values = [format_number(label.factor * float(i[name])) for name in ("value", "sd")]
        rows.append([label.words, label.unit or "–", *values, str(i.get("reason", ""))])
    return page.table(["input", "unit", "value", "sd", "why this standard deviation"], rows)


def _describe_fixed_inputs(data: dict[str, Any]) -> list[str]:
    fixed = [describe_key(str(key)).words for key in data.get("left_out", [])]
    return [page.paragraph(f"Without a standard deviation, so fixed: {', '.join(fixed)}.", "small")] if fixed else []


def _effect_table(number: dict[str, Any], name: str, inputs: Sequence[dict[str, Any]]) -> str:
    """Change of one number by each input, the largest fraction of its variance first."""
    keys = sorted((str(i["key"]) for i in inputs), key=lambda key: -float(number["total"][key]))
    unit = _unit(number, difference=True).strip() or "–"
    head = [_output_words(name, number), f"change per sd ({unit})", "first order (%)", "total (%)"]
    rows = [
        [describe_key(key).words, format_number(number["per_sd"][key]),
         *(format_number(100 * float(number[part][key])) for part in ("first_order", "total"))]
        for key in keys
    ]  # fmt: skip
    return page.table(head, rows)


# --- plan -------------------------------------------------------------------------------------------------------
def write_plan_report(folder: Path, subject: ReportSubject | None = None) -> Path:
    """Write the report of a plan into its result folder; returns its path.  Raises BadInput.

    `subject`: conditions and method, known where the campaign is at hand.
    """
    file = folder / "plan.json"
    data = _read_json(file)
    with _refuse_damaged(file):
        effects = sorted(data["effects"], key=lambda e: -float(e["z_left"]))
        added = [*data.get("experiments", []), *data.get("sensors", [])]
        answer = _summarise_plan(effects, added)
        picture = _stored_picture(
            folder / "separability.png", answer[0],
            "Left: correlation of the signatures. Right: signal-to-noise ratio that no other effect imitates.",
        )  # fmt: skip
        sections = [
            Section("effects", "Effects that these measurements can distinguish", [_plan_table(effects)]),
            Section("picture", "Signatures of the effects", picture),
            Section("added", "What to measure in addition", _addition_table(added)),
            _terms("plan"),
        ]
        title = f"{data.get('title', '')}: plan of the measurements"
    return _write(page.render_report(title, _answer(*answer), subject, sections), folder)


def _name_effects(names: Sequence[Any]) -> str:
    shown = [effect_label(str(n)) for n in names]
    more = f" and {len(shown) - MAX_EFFECTS_NAMED} more" if len(shown) > MAX_EFFECTS_NAMED else ""
    return ", ".join(shown[:MAX_EFFECTS_NAMED]) + more


def _summarise_plan(effects: Sequence[dict[str, Any]], added: Sequence[dict[str, Any]]) -> list[str]:
    """How many effects can be distinguished, and which measurement would help most."""
    good = [e["effect"] for e in effects if e.get("separable")]
    words = f"These measurements can distinguish {len(good)} of {len(effects)} effects from all others"
    helpful = next((a for a in added if a.get("helps")), None)
    more = (
        f"One more condition or sensor, {helpful['words']}, also distinguishes {_name_effects(helpful['helps'])}."
        if helpful
        else "No single further condition or sensor distinguishes more."
    )
    return [f"{words}: {_name_effects(good)}." if good else f"{words}.", more]


def _plan_table(effects: Sequence[dict[str, Any]]) -> str:
    rows = []
    for e in effects:
        size = float("nan") if e.get("detectable") is None else float(e["detectable"])
        rival = "none" if not e.get("rho") else f"{effect_label(str(e['nearest']))} ({format_number(float(e['rho']))})"
        rows.append([
            effect_label(str(e["effect"])), "yes" if e.get("separable") else "no", format_number(float(e["z"])),
            format_number(float(e["z_left"])),
            f"{format_number(size)}{unit_suffix(str(e.get('unit', '1')))}" if math.isfinite(size) else "never", rival,
        ])  # fmt: skip
    head = ["effect", "distinguished", "signal alone", "with all others free", "detectable at 5 sigma", "nearest rival"]
    return page.table(head, rows)


def _addition_table(added: Sequence[dict[str, Any]]) -> list[str]:
    if not added:
        return [page.paragraph("Nothing further was computed: every effect that shows can be distinguished.")]
    rows = [[str(a["words"]), _name_effects(a.get("helps") or []) or "nothing more"] for a in added]
    return [page.table(["one more condition or sensor", "then also distinguished"], rows)]
