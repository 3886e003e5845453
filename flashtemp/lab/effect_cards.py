"""Effects as cards: a switch, the cause, a picture of where the effect acts, and its parameters where it is on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from nicegui import ui

from flashtemp.lab.case_form import Change, KeyField
from flashtemp.lab.drawing import Drawing
from flashtemp.lab.effect_places import OTHER_PLACE, PICTURE_BOX, PLACES, draw_places, find_effect_places
from flashtemp.lab.key_groups import stated_value, table_keys
from flashtemp.lab.workspace import escape_control
from flashtemp.model.case_file import split_names
from flashtemp.physics.effect import Effect, catalogue

MAX_CAUSE_LETTERS: Final = 140  # of an effect file's own words on a card
Switch = Callable[[str, bool], Any]  # called with the entry of `effects` and whether it is to be on
EffectsByName = Mapping[str, type[Effect]]


def listed_effects(raw: Mapping[str, Any]) -> list[str]:
    """The entries of `effects` in the tables of a text: names of the catalogue and effect files."""
    return list(dict.fromkeys(split_names(raw.get("effects", [])) or []))


def effect_name(entry: str) -> str:
    """The name of an effect, by its entry: for an effect file, the file name without its ending.

    >>> effect_name("wear"), effect_name("own/fan.py")
    ('wear', 'fan')
    """
    return Path(entry).stem if entry.endswith(".py") else entry


def describe_conflict(effect: type[Effect], has_layers: bool) -> str:
    """Why an effect cannot act in a case whose block `has_layers`; "" where it can."""
    if effect.uniform and has_layers:
        return "It assumes a block of one material: remove the layers, or switch it off."
    return ""


def find_same_signature(name: str, chosen: Sequence[str], known: EffectsByName) -> list[str]:
    """The chosen effects that change a camera image in the same way as the effect `name`."""
    like = known[name].alike
    return [
        n for n in chosen
        if n != name and n in known and (known[n].alike == name or (like and like in (n, known[n].alike)))
    ]  # fmt: skip


class EffectCards:
    """Cards of the effects that are on, and the catalogue of those that can be added."""

    def __init__(self, switch: Switch, change: Change):
        self.switch, self.change = switch, change
        self.fields: dict[str, KeyField] = {}
        self.notes: dict[str, Any] = {}
        self.entries: list[str] = []
        self.known: EffectsByName = {}
        self.has_layers = False
        self.offers: dict[str, tuple[Any, str, set[str]]] = {}  # card, words to search, places
        self.place, self.is_built = "", False
        self.noted: Any = None  # what the notes on the cards show

    def show(self, raw: Mapping[str, Any]) -> None:
        """Show the cards for the tables of a text."""
        self.on_box = ui.element("div").classes("ft-effects")
        self.none_on = ui.label(
            "No effect is on: friction heat, contact, conduction, and cooling by the air are always computed."
        ).classes("ft-muted")
        with ui.element("h3"):
            ui.label("Add an effect")
        with ui.element("div").classes("ft-bar"):
            self.search = ui.input("Search effects", on_change=lambda: self._filter()).classes("grow")
            self.search.props("outlined dense clearable debounce=150")
            with self.search.add_slot("prepend"):
                ui.icon("search")
        self._show_place_filter()
        self.none_found = ui.label("No effect has these words at this place.").classes("ft-muted")
        self.catalogue = ui.element("div").classes("ft-catalogue").props("tabindex=0 role=group")
        self.catalogue.props["aria-label"] = "catalogue of effects"
        with self.catalogue, ui.element("div").classes("ft-effects"):
            for name, effect in catalogue().items():
                if not effect.base:
                    self._show_offer(name, effect)
        self.fill(raw, {})

    def _show_place_filter(self) -> None:
        """Buttons that restrict the catalogue to effects at one place."""
        self.place_buttons: dict[str, Any] = {}
        with ui.element("div").classes("ft-chips").props('role=group aria-label="where the effect acts"'):
            for title in ("", *(place.title for place in PLACES)):
                button = _PlainButton(title or "everywhere").classes("ft-chip")
                button.on("click", lambda _, title=title: self._choose_place(title))
                self.place_buttons[title] = button
        self._mark_place()

    def _mark_place(self) -> None:
        for title, button in self.place_buttons.items():
            button.props["aria-pressed"] = "true" if title == self.place else "false"

    def _choose_place(self, title: str) -> None:
        self.place = title
        self._mark_place()
        self._filter()

    def _filter(self) -> None:
        """Show the effects that are off, at the chosen place, with all words of the search."""
        wanted = (self.search.value or "").lower().split()
        found = 0
        for name, (box, text, places) in self.offers.items():
            at_place = not self.place or self.place in places
            is_visible = name not in self.entries and at_place and all(word in text for word in wanted)
            found += is_visible
            if box.visible != is_visible:
                box.set_visibility(is_visible)
        self.none_found.set_visibility(found == 0)

    # --- cards ------------------------------------------------------------------------------------------------
    def _show_offer(self, name: str, effect: type[Effect]) -> None:
        with ui.element("article").classes("ft-effect") as box:
            self._show_head(name, name, effect, False)
        text = " ".join([name.replace("_", " "), name, effect.cause, *effect.tells]).lower()
        self.offers[name] = (box, text, {place.title for place in find_effect_places(effect)})

    def _show_head(self, entry: str, name: str, effect: type[Effect] | None, is_on: bool) -> None:
        """Picture, name, cause and switch of an effect."""
        places = find_effect_places(effect) if effect is not None else (OTHER_PLACE,)
        where = ", ".join(place.title for place in places)
        with ui.element("div").classes("ft-effect-head"):
            Drawing(*PICTURE_BOX, f"acts on: {where}", draw_places(places))
            with ui.element("div").classes("min-w-0"):
                ui.label(escape_control(name.replace("_", " "))).classes("ft-effect-name")
                ui.label(_describe_cause(effect)).classes("ft-small ft-muted")
            toggle = ui.switch(value=is_on).props("dense")
            toggle.props["aria-label"] = f"{'switch off' if is_on else 'switch on'} {escape_control(name)}"
            toggle.on_value_change(lambda e: self._toggled(toggle, entry, is_on))

    def _toggled(self, toggle: Any, entry: str, is_on: bool) -> None:
        if toggle.value != is_on:
            self.switch(entry, not is_on)
            if not is_on:  # the card of the catalogue is used again
                toggle.value = False

    def _show_on(self, entry: str, raw: Mapping[str, Any]) -> None:
        """The card of an effect that is on, with its parameters."""
        name = effect_name(entry)
        effect = self.known.get(name) or catalogue().get(name)
        with ui.element("article").classes("ft-effect on") as card:
            card.props["aria-label"] = escape_control(name)
            self._show_head(entry, entry if effect is None else name, effect, True)
            self.notes[entry] = ui.column().classes("w-full gap-1")
            if effect is None:
                return
            with ui.element("div").classes("ft-keys"):
                for key in table_keys(name, {name: effect}):
                    field = KeyField(key, self.change)
                    field.show({})
                    field.fill(stated_value(raw, key))
                    self.fields[key.dotted] = field

    # --- updates ----------------------------------------------------------------------------------------------
    def fill(self, raw: Mapping[str, Any], known: EffectsByName) -> None:
        """Show the effects and parameters of a text; `known` are the effects of a checked case, by name."""
        entries, new = listed_effects(raw), {n: e for n, e in known.items() if n not in catalogue()}
        self.has_layers = bool(raw.get("layers"))
        if entries != self.entries or set(new) - set(self.known) or not self.is_built:
            self.entries, self.known = entries, new or self.known
            self._build_on(raw)
            self._filter()
        for field in self.fields.values():
            field.fill(stated_value(raw, field.key))

    def _build_on(self, raw: Mapping[str, Any]) -> None:
        self.is_built = True
        self.on_box.clear()
        self.fields, self.notes = {}, {}
        with self.on_box:
            for entry in self.entries:
                self._show_on(entry, raw)
        self.none_on.set_visibility(not self.entries)
        self.on_box.set_visibility(bool(self.entries))
        self.noted = None
        self.show_notes([])

    def show_notes(self, faults: Iterable[str]) -> None:
        """Show on each card what the effect needs, with what it does not go together, and its errors."""
        lines, known = list(faults), {**catalogue(), **self.known}
        if (state := (lines, self.has_layers, self.entries, set(self.notes))) == self.noted:
            return
        self.noted = state
        for entry, box in self.notes.items():
            name = effect_name(entry)
            effect = known.get(name)
            own = [line for line in lines if f"'{name}'" in line or line.startswith(f"{name}.")]
            box.clear()
            with box:
                if effect is not None:
                    self._show_notes_of(name, effect, known)
                for text in own:
                    ui.label(escape_control(text)).classes("ft-note error ft-small")

    def _show_notes_of(self, name: str, effect: type[Effect], known: EffectsByName) -> None:
        """What an effect needs, what excludes it, and which others look alike."""
        if effect.needs:
            ui.label(f"Needs {effect.needs}.").classes("ft-small ft-muted")
        if conflict := describe_conflict(effect, self.has_layers):
            ui.label(conflict).classes("ft-note warning ft-small")
        chosen = [effect_name(entry) for entry in self.entries]
        if same := find_same_signature(name, chosen, known):
            names = " and ".join(n.replace("_", " ") for n in same)
            ui.label(f"A camera cannot tell it from {escape_control(names)}.").classes("ft-small ft-muted")


class _PlainButton(ui.element):
    """A button of HTML with a text."""

    def __init__(self, text: str):
        super().__init__("button")
        self.props["type"] = "button"
        with self:
            ui.label(text).classes("inline")


def _describe_cause(effect: type[Effect] | None) -> str:
    """What an effect stands for, in a sentence."""
    if effect is None:
        return "an effect file: its parameters are shown once you allow it to run"
    cause = escape_control(str(effect.cause))[:MAX_CAUSE_LETTERS]
    return f"{cause[:1].upper()}{cause[1:]}." if cause else "The file states no cause."
