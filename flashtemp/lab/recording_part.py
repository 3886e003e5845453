"""The part of the camera page that shows a recording: image in mm, measurements, facts, conditions, the next step."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from nicegui import run, ui

from flashtemp.camera.recording import Recording
from flashtemp.lab.charts import N_SERIES_COLOURS, chart_options, line_series, show_chart
from flashtemp.lab.conditions import describe_values
from flashtemp.lab.file_name_conditions import guess_conditions
from flashtemp.lab.frame_cards import DefectList, show_facts, show_histogram, show_mean
from flashtemp.lab.frame_server import FrameServer
from flashtemp.lab.marked_image import IMAGE_ID
from flashtemp.lab.measurement_panel import MeasurementPanel
from flashtemp.lab.opened_frames import OpenedFrames
from flashtemp.lab.page_layout import action, card, chip, page_address, refuse_damaged, show_errors
from flashtemp.lab.recording_facts import RecordingUse, describe_recording, find_template, find_uses
from flashtemp.lab.thermal_viewer import RECORDING_AXES, ThermalViewer
from flashtemp.lab.workspace import escape_control, list_folder

MAX_CURVES: Final = 12  # sensors that are drawn
MAX_USES: Final = 10  # campaigns that are listed


class RecordingPart:
    """A recording `name` of the folder: everything that it holds, and where to go from here."""

    def __init__(self, folder: Path, server: FrameServer, name: str, opened: OpenedFrames):
        self.folder, self.server, self.name, self.opened = folder, server, name, opened
        self.viewer: ThermalViewer | None = None

    @property
    def recording(self) -> Recording:
        """The recording that is shown."""
        assert self.opened.recording is not None
        return self.opened.recording

    def show(self, address: str, storage_key: str) -> Any:
        """Show the recording; returns the element for frames to compare with, None where there is no image."""
        pair = None
        with ui.element("div").classes("ft-split side tv-part"):
            if self.recording.is_single_row:
                self._show_curves()
            else:
                with card(), ui.element("div").classes("w-full") as pair:
                    self.viewer = ThermalViewer(self.opened, address, image_id=IMAGE_ID)
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                self._show_use()
                self._show_facts(address)
            with ui.column().classes("min-w-0 gap-4 w-full items-stretch"):
                if self.viewer is not None:
                    self._show_measurements(self.viewer, storage_key)
                    if len(self.opened.time) > 1:
                        show_mean(self.opened)
                show_histogram(self.opened)
        return pair

    def _show_measurements(self, viewer: ThermalViewer, storage_key: str) -> None:
        """The measurements, which the browser keeps."""
        axes = RECORDING_AXES[self.recording.view] if self.opened.find_map() is not None else None
        panel = MeasurementPanel(viewer, self.opened, self.opened.find_map, axes)
        panel.show()
        viewer.on_frame(panel.show_frame)
        viewer.keep_in(storage_key, lambda kept: panel.restore(kept.get("measurements")))

    def _show_curves(self) -> None:
        """Curves of sensors over time, or profiles along x at some times."""
        known, unit = self.recording, self.opened.unit
        T = known.temperature[:, 0]
        if known.places is not None:
            title, x_label, name = "Temperature of the sensors", self.opened.time_label, "sensors_over_time"
            chosen = range(min(T.shape[1], MAX_CURVES))
            curves = [line_series(known.places.names[k], known.time, T[:, k], n) for n, k in enumerate(chosen)]
            about = "" if T.shape[1] <= MAX_CURVES else f"The first {MAX_CURVES} of {T.shape[1]} sensors."
        else:
            title, x_label, name = "Temperature along the block", "x, mm", "profiles"
            frames = np.unique(np.linspace(0, len(T) - 1, N_SERIES_COLOURS).round().astype(int))
            curves = [line_series(f"{known.time[k]:.4g} s", 1e3 * known.u, T[k], n) for n, k in enumerate(frames)]
            about = "At some times from the first start of sliding."
        with card(title, about):
            show_chart(chart_options(curves, x_label, f"temperature, {unit}"), name, title.lower())

    # --- facts and next step ------------------------------------------------------------------------------------
    def _show_use(self) -> None:
        """The conditions under which it was made, by campaign, and the next step."""
        file = self.opened.files[0]
        listing = list_folder(self.folder)
        uses, template = find_uses(self.folder, listing, file), find_template(self.folder, listing, file)
        about = "Its places are known: they count from the leading edge and the interface, its times from sliding."
        with card("Recording", about):
            for use in uses[:MAX_USES]:
                self._show_conditions(use)
            if not uses:
                guessed = ", ".join(guess_conditions(self.name).values())
                words = "A campaign states load and speed of this recording; none of this folder lists it yet."
                ui.label(escape_control(words + (f" Its name says {guessed}." if guessed else "")))
            with ui.row().classes("gap-2"):
                if uses:
                    target = page_address("campaign", open=uses[0].campaign)
                    action("Open the campaign", lambda: ui.navigate.to(target), "arrow_forward", main=True)
                else:
                    target = page_address("campaign", **({} if listing.campaigns else {"new": 1}))
                    label = "To the campaigns" if listing.campaigns else "Put a campaign together"
                    action(label, lambda: ui.navigate.to(target), "arrow_forward", main=True)
                if template is not None:
                    again = page_address("camera", template=template)
                    button = action("Correct the marks", lambda: ui.navigate.to(again), "edit")
                    button.tooltip("import it again from its camera files, with the marks and values of its template")

    def _show_conditions(self, use: RecordingUse) -> None:
        """The conditions that one campaign states."""
        with ui.row().classes("items-center gap-2"):
            name = escape_control(str(use.campaign))
            ui.link(name, page_address("campaign", open=use.campaign)).classes("break-all")
            if use.is_held_out:
                chip("held out")
        with show_errors(self.folder), refuse_damaged(self.folder / use.campaign):
            values = describe_values(use.conditions).values()
            rows = [(re.split("[,;]", value.meaning)[0], value.value) for value in values]
            if use.sigma_K is not None:
                stated = use.sigma_K if isinstance(use.sigma_K, str) else f"{use.sigma_K} K"
                rows.append(("noise of one pixel in the campaign", stated))
            show_facts(rows or [("conditions", "those of the case")], f"conditions in {name}")

    def _show_facts(self, address: str) -> None:
        with card("Facts"):
            place = ui.column().classes("w-full")
            if self.viewer is not None:
                DefectList(self.folder, self.opened, self.viewer, self.server, address).show()

        async def describe() -> None:
            with place, show_errors(self.folder):
                rows = await run.io_bound(describe_recording, self.recording)
                show_facts(rows or [], "facts of the recording")

        ui.timer(0.05, describe, once=True)
