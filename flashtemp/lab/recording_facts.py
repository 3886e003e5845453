"""What is known of a recording: its facts in words, the campaigns that use it, and the template that made it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from flashtemp.camera.image_screening import temporal_noise
from flashtemp.camera.recording import Recording
from flashtemp.errors import FlashtempError
from flashtemp.lab.campaign_document import CampaignDocument
from flashtemp.lab.recording_store import MAX_NOISE_VALUES
from flashtemp.lab.saving import read_text
from flashtemp.lab.workspace import FolderListing, find_own_file
from flashtemp.model.case_file import parse_toml

VIEW_WORDS: Final = {
    "sidewall": "sidewall: x from the leading edge, z above the interface",
    "wake": "wake: x behind the leading edge, y from the centre line of the road",
    "profile": "profile: along x from the leading edge",
    "points": "sensors at points",
}
FACT_WORDS: Final = {  # attribute of a recording: what it is and its unit
    "emissivity": ("emissivity", ""),
    "reflected_degC": ("reflected temperature", "°C"),
    "psf_sigma_px": ("blur (1 sd)", "px"),
    "fixed_pattern_K": ("scatter between pixels", "K"),
    "registration_sigma_px": ("position of the block (1 sd)", "px"),
    "exposure_s": ("exposure time", "s"),
    "fps": ("frame rate", "1/s"),
}


@dataclass(frozen=True)
class RecordingUse:
    """An entry of a `campaign` that uses a recording, with its `conditions` by key and the noise `sigma_K`."""

    campaign: Path
    conditions: Mapping[str, Any]
    sigma_K: Any
    is_held_out: bool


def describe_recording(known: Recording) -> list[tuple[str, str]]:
    """Names and values of the facts of a recording, as text."""
    low, high, number = known.span
    missing = 100.0 * (1.0 - number / known.temperature.size)
    first, last = int(known.repetition.min()), int(known.repetition.max())
    rows = [("view", VIEW_WORDS[known.view]), ("frames", str(known.frames)), *_describe_pixels(known)]
    rows.append(("time", f"{known.time[0]:.4g} to {known.time[-1]:.4g} s from the first start of sliding"))
    rows.append(("repetitions", f"{first} to {last}" if last > first else str(first)))
    rows.append(("temperature", f"{low:.2f} to {high:.2f} °C, {missing:.2g} % of the values missing"))
    rows.append(("noise" if known.places is not None else "noise of one pixel", _describe_noise(known)))
    for name, (words, unit) in FACT_WORDS.items():
        if (value := getattr(known, name)) is not None:
            rows.append((words, f"{value:g} {unit}".rstrip()))
    return [*rows, ("camera", known.camera), ("made from", known.source or "not stated")]


def _describe_pixels(known: Recording) -> list[tuple[str, str]]:
    """Number and size of the pixels, and what they cover."""
    if known.places is not None:
        return [("sensors", f"{len(known.u)}: {', '.join(known.places.names[:12])}")]
    du, dv = (f"{1e3 * size:.3g}" for size in known.pitch)
    covered = f"x {1e3 * known.u[0]:.1f} to {1e3 * known.u[-1]:.1f} mm"
    if known.is_single_row:
        return [("pixels", f"{len(known.u)} of {du} mm"), ("covered", covered)]
    up = "y" if known.view == "wake" else "z"
    covered += f", {up} {1e3 * known.v[0]:.1f} to {1e3 * known.v[-1]:.1f} mm"
    return [("pixels", f"{len(known.u)} x {len(known.v)} of {du} x {dv} mm"), ("covered", covered)]


def _describe_noise(known: Recording) -> str:
    stated = "not stated" if known.netd_K is None else f"{known.netd_K:g} K stated"
    pixels = known.temperature[0].size
    if known.places is not None or pixels < 3:
        return stated
    measured = float(temporal_noise(known.temperature[: max(2, MAX_NOISE_VALUES // pixels)]))
    return f"{stated}, {measured:.2g} K measured" if np.isfinite(measured) else stated


def find_uses(folder: Path, listing: FolderListing, file: Path) -> list[RecordingUse]:
    """The entries of all campaigns of the folder that use a recording; campaigns that cannot be read have none."""
    found: list[RecordingUse] = []
    for campaign in listing.campaigns:
        try:
            document = CampaignDocument(folder, str(campaign), read_text(folder, str(campaign))[0])
        except (FlashtempError, OSError):
            continue
        for entry in document.list_entries("recording"):
            if document.find_file(entry.get("file")) == file:
                given = entry.get("with")
                conditions = given if isinstance(given, dict) else {}
                found.append(RecordingUse(campaign, conditions, entry.get("sigma_K"), entry.get("held_out") is True))
    return found


def find_template(folder: Path, listing: FolderListing, file: Path) -> Path | None:
    """The template of the folder that made a recording: its `out` names it, or it has the same name beside it."""
    for template in listing.templates:
        path = find_own_file(folder, template)
        if path is None:
            continue
        try:
            out = parse_toml(path.read_text(encoding="utf-8")).get("out")
        except (OSError, ValueError, RecursionError):
            continue
        made = path.parent / out if isinstance(out, str) else path.with_suffix(".nc")
        if os.path.normpath(made) == str(file):
            return template
    return None
