"""Free keys of a campaign with their priors, and stated uncertainties of the other inputs, chosen from lists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from nicegui import ui

from flashtemp.comparison.known_inputs import APPROXIMATE_ZEROS, is_zero, known_keys
from flashtemp.discovery.hypotheses.candidates import prior_sd_of_key
from flashtemp.discovery.hypotheses.input_kinds import input_kind
from flashtemp.lab.campaign_checks import CampaignCheck
from flashtemp.lab.campaign_document import CampaignDocument, format_cell, parse_cell
from flashtemp.lab.key_units import describe_value
from flashtemp.lab.page_layout import heading, show_fault_lines
from flashtemp.lab.toml_tables import set_top_key
from flashtemp.lab.workspace import escape_control
from flashtemp.model.case import Case
from flashtemp.model.case_file import flatten_tables
from flashtemp.model.priors import USUAL_SD, expand_materials
from flashtemp.model.schema import is_physical_number
from flashtemp.physics.effect import Param

USUAL_KNOWN_SD: Final = 0.02  # relative, of an input without a usual one
FREE, KNOWN = "free", "known"
VIEW_WORDS: Final = {"emissivity": "emissivity of the surface", "reflected_temperature": "reflected temperature"}


@dataclass(frozen=True)
class InputKey:
    """A number of the case or its cameras: its meaning, unit and value in the case."""

    name: str
    about: str
    unit: str
    value: Any

    @property
    def words(self) -> str:
        """Key, meaning and value in one line."""
        return f"{self.name}: {self.about} ({self.value_words})" if self.value_words else f"{self.name}: {self.about}"

    @property
    def value_words(self) -> str:
        """The value with its unit."""
        return describe_value(self.value, Param(self.value, self.unit, "")) if self.value is not None else ""


def list_free_keys(case: Case) -> dict[str, InputKey]:
    """Keys of a case that a campaign may fit."""
    return {
        f"{table}.{name}": InputKey(f"{table}.{name}", param.about, param.unit, case.values[table].get(name))
        for table in case.values
        for name, param in case.declared_params(table).items()
        if is_physical_number(table, param)
    }


def list_known_keys(case: Case) -> dict[str, InputKey]:
    """Keys whose uncertainty a campaign may state: numbers of the case, its materials and its cameras.

    Zeros that switch something off have none.
    """
    full = expand_materials(case)
    out = {}
    for key, unit in known_keys(case).items():
        table, _, name = key.rpartition(".")
        if table in full.values:
            value = full.values[table].get(name)
            if unit == "degC" or key in APPROXIMATE_ZEROS or not is_zero(value):
                out[key] = InputKey(key, full.declared_params(table)[name].about, unit, value)
        else:
            out[key] = InputKey(key, VIEW_WORDS.get(name, name), unit, None)
    return out


def read_free(raw: dict[str, Any], case: Case | None) -> dict[str, float | None]:
    """Free keys with the relative standard deviation that is stated of each, None where none is."""
    given = raw.get(FREE)
    if isinstance(given, dict):
        return dict(flatten_tables(given))
    if isinstance(given, list):
        return {key: None for key in given if isinstance(key, str)}
    return dict.fromkeys(case.free if case is not None else ())


def write_free(free: dict[str, float | None]) -> Any:
    """The value of `free`: a list without standard deviations, else a table in which every key has one.

    >>> write_free({"friction.mu": None}), write_free({"friction.mu": 0.1, "block.length": None})
    (['friction.mu'], {'friction.mu': 0.1, 'block.length': 0.2})
    """
    if all(sd is None for sd in free.values()):
        return list(free)
    return {key: prior_sd_of_key(key) if sd is None else sd for key, sd in free.items()}


def suggest_known(key: InputKey) -> Any:
    """A usual uncertainty of an input: a relative number, or a text with its unit.

    >>> suggest_known(InputKey("contact.pressure", "", "Pa", 1e5)), suggest_known(InputKey("b.T", "", "degC", 20.0))
    (0.02, '0.5 K')
    """
    if key.name in APPROXIMATE_ZEROS and is_zero(key.value):
        return f"{input_kind(key.name, key.unit, is_zero=True).sd:g} {key.unit}"
    sd, relative, _ = USUAL_SD.get(key.name, (0.5, False, "") if key.unit == "degC" else (USUAL_KNOWN_SD, True, ""))
    if not relative and key.unit in ("", "1"):  # without a unit it would be read as relative
        sd, relative = sd / abs(key.value) if key.value else USUAL_KNOWN_SD, True
    return sd if relative else f"{sd:g} {'K' if key.unit == 'degC' else key.unit}"


class FreeKeysPanel:
    """Two lists, of free keys and of known inputs, which edit the text."""

    def __init__(self, document: CampaignDocument):
        self.document = document
        self.case: Case | None = None
        self.boxes: dict[tuple[str, str], Any] = {}
        self.shown: Any = None
        self.options: dict[str, dict[str, InputKey]] = {FREE: {}, KNOWN: {}}

    def show(self) -> None:
        """Show both lists."""
        self.lists, self.choices, self.errors = {}, {}, {}
        for kind, title, about, label in (
            (FREE, "Free keys", "Fitted before anything else is suspected, each within its prior.", "add a free key"),
            (KNOWN, "Known inputs", "How well other inputs are known: 0.02 of the value, or with a unit, 0.3 K.",
             "state how well an input is known"),
        ):  # fmt: skip
            with ui.column().classes("gap-2 w-full min-w-0"):
                heading(3, title)
                ui.label(about).classes("ft-muted ft-small")
                self.errors[kind] = ui.column().classes("ft-note error gap-0").props("role=alert")
                self.errors[kind].set_visibility(False)
                self.lists[kind] = ui.element("div").classes("w-full")
                choice = ui.select({}, label=label, with_input=True, on_change=lambda _, k=kind: self._add_key(k))
                self.choices[kind] = choice.props("outlined dense").classes("w-full")
        self.update_values()

    def update_values(self) -> None:
        """Show the text as it stands."""
        raw = self.document.raw
        if raw is None:
            return
        values_of = {kind: self._values(kind) for kind in (FREE, KNOWN)}
        state = (values_of, FREE in raw, self.case is not None)
        if state == self.shown:
            return
        self.shown = state
        self.boxes = {}
        for kind, values in values_of.items():
            self.lists[kind].clear()
            with self.lists[kind]:
                self._show_rows(kind, values)
        self._offer_keys()

    def update_check(self, check: CampaignCheck) -> None:
        """Show the errors of both lists, and offer the keys of the case."""
        for kind, place in self.errors.items():
            show_fault_lines(place, check.key_faults(kind))
        if check.case is None:
            return
        self.case = check.case
        options = {FREE: list_free_keys(check.case), KNOWN: list_known_keys(check.case)}
        if options != self.options:  # else the rows stay, as the user may be typing in one
            self.options, self.shown = options, None
        self.update_values()

    def _show_rows(self, kind: str, values: dict[str, Any]) -> None:
        if not values:
            nothing = (
                "No key is free." if kind == FREE else "None stated: each input has the usual uncertainty of its kind."
            )
            ui.label(nothing).classes("ft-muted")
            return
        with ui.element("ul").classes("ft-keys"):
            for key, value in values.items():
                with ui.element("li"):
                    self._show_row(kind, key, value)

    def _show_row(self, kind: str, key: str, value: Any) -> None:
        about = self.options[kind].get(key)
        name = escape_control(key)
        with ui.column().classes("gap-0 grow min-w-0"):
            ui.label(name).classes("ft-mono ft-small break-all")
            if about is not None:
                words = f"{about.about}; {about.value_words} in the case" if about.value_words else about.about
                ui.label(words).classes("ft-muted ft-small")
        box = ui.input(value=format_cell(value)).props("outlined dense hide-bottom-space").classes("ft-cell")
        box.props["aria-label"] = f"{'prior of' if kind == FREE else 'uncertainty of'} {name}"
        if kind == FREE:
            box.props["placeholder"] = f"{prior_sd_of_key(key):g} usual"
            box.tooltip("relative standard deviation of the prior")
        box.on("change", lambda: self._change_value(kind, key, box.value))
        button = ui.button(icon="close", on_click=lambda: self._remove_key(kind, key)).props("flat round dense")
        button.props["aria-label"] = f"remove {name} from the {kind} ones"
        self.boxes[kind, key] = box

    def _offer_keys(self) -> None:
        chosen = {key for kind in (FREE, KNOWN) for key in self._values(kind)}
        for kind, choice in self.choices.items():
            choice.set_options({k: key.words for k, key in self.options[kind].items() if k not in chosen}, value=None)

    # --- edits ---------------------------------------------------------------------------------------------
    def _values(self, kind: str) -> dict[str, Any]:
        raw = self.document.raw or {}
        if kind == FREE:
            return read_free(raw, self.case)
        given = raw.get(KNOWN)
        return flatten_tables(given) if isinstance(given, dict) else {}

    def _write_values(self, kind: str, values: dict[str, Any]) -> None:
        value = write_free(values) if kind == FREE else values or None
        self.document.apply_edit(lambda text: set_top_key(text, kind, value))
        self.update_values()

    def _add_key(self, kind: str) -> None:
        key = self.choices[kind].value
        if key:
            new = None if kind == FREE else suggest_known(self.options[KNOWN][key])
            self._write_values(kind, {**self._values(kind), key: new})

    def _remove_key(self, kind: str, key: str) -> None:
        self._write_values(kind, {k: v for k, v in self._values(kind).items() if k != key})

    def _change_value(self, kind: str, key: str, typed: str) -> None:
        value = parse_cell(typed)
        if value is None and kind == KNOWN:
            self._remove_key(kind, key)
        else:
            values = {**self._values(kind), key: value}
            usual = all(sd is None or sd == prior_sd_of_key(k) for k, sd in values.items())
            self._write_values(kind, dict.fromkeys(values) if kind == FREE and value is None and usual else values)


class CandidateSwitches:
    """A switch for every effect that `discover` may try; the usual choice needs no line in the text."""

    def __init__(self, document: CampaignDocument, told: Callable[[str], Any]):
        self.document, self.told = document, told
        self.switches: dict[str, Any] = {}
        self.usual: tuple[str, ...] = ()
        self.is_filling = False

    def show(self) -> None:
        """Show the place for the switches; they appear with the first check."""
        self.body = ui.element("div").classes("w-full")
        with self.body:
            ui.label("The effects appear here once the case can be read.").classes("ft-muted")

    def update_check(self, check: CampaignCheck) -> None:
        """Show the switches of the effects of the case."""
        if check.case is None:
            return
        effects, known = check.candidates, check.case.known_effects
        usual = tuple(name for name, reason in effects.items() if not reason)
        if (tuple(effects), usual) != (tuple(self.switches), self.usual):
            self.usual = usual
            self.switches = {}
            self.body.clear()
            with self.body, ui.element("div").classes("ft-grid"):
                for name, reason in effects.items():
                    with ui.column().classes("gap-0"):
                        switch = ui.switch(name.replace("_", " "), on_change=lambda: self._write_choice()).props(
                            "dense"
                        )
                        ui.label(escape_control(known[name].cause)).classes("ft-muted ft-small")
                        if reason:
                            words = reason.split("; name it")[0]
                            ui.label(f"Off by default: {words}.").classes("ft-muted ft-small")
                        self.switches[name] = switch
        self.update_values()

    def update_values(self) -> None:
        """Show the choice of the text."""
        chosen = self._stated_choice()
        self.is_filling = True  # a switch that is set here is no choice of the user
        for name, switch in self.switches.items():
            switch.set_value(name in chosen)
        self.is_filling = False
        self.told(f"{sum(name in chosen for name in self.switches)} of {len(self.switches)} effects are tried")

    def _stated_choice(self) -> list[Any]:
        """The candidates of the text, or the usual ones."""
        given = (self.document.raw or {}).get("candidates")
        return given if isinstance(given, list) else list(self.usual)

    def _write_choice(self) -> None:
        if self.is_filling:
            return
        chosen = [name for name, switch in self.switches.items() if switch.value]
        if {*chosen} != {*self._stated_choice()} & {*self.switches}:
            value = None if {*chosen} == {*self.usual} else chosen
            self.document.apply_edit(lambda text: set_top_key(text, "candidates", value))
            self.update_values()
