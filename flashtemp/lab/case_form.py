"""The form of a case: one field per key in groups, with units, defaults, search, and errors at their fields."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.lab.key_groups import (
    CaseKey,
    KeyGroup,
    list_extra_tables,
    list_group_keys,
    stated_value,
    table_keys,
)
from flashtemp.lab.key_units import (
    convert_to_key_unit,
    describe_key,
    describe_value,
    format_value,
    is_default,
    natural_unit,
    parse_value,
    read_number,
    show_number,
    unit_choices,
    unit_label,
)
from flashtemp.lab.page_layout import set_prop
from flashtemp.lab.workspace import escape_control
from flashtemp.model.schema import MESH_LEVEL_FACTORS, named_table_kind
from flashtemp.physics.material import LIBRARY, Material

Change = Callable[[CaseKey, Any], Any]  # called with a key and its new value, None for the default
TYPING_PAUSE_MS: Final = 150  # after which what was typed is checked
BINDINGS: Final = ("auto", "scikits-odes", "scikit-sundae")
EXTRA_TITLES: Final = {"materials": "Material", "layers": "Layer"}


class _UnitOption(TextElement):
    """One unit of the list beside a field."""

    def __init__(self, unit: str):
        super().__init__(tag="option", text=unit_label(unit))
        self.props["value"] = unit


class KeyField:
    """The field of one key: text or choice, its unit, and a button that restores the default."""

    def __init__(self, key: CaseKey, change: Change):
        self.key, self.change, self.unit = key, change, natural_unit(key.param)
        self.stated: Any = None
        self.filling = False

    @property
    def is_changed(self) -> bool:
        """Whether the text states another value than the default."""
        if self.stated is None or (self.key.param.value is None and named_table_kind(self.key.table)):
            return False  # materials and layers have no defaults
        return not is_default(self.stated, self.key.param)

    # --- elements ---------------------------------------------------------------------------------------------
    def show(self, materials: Mapping[str, str]) -> None:
        """Show the field; `materials` are the names to choose from, with their values in words."""
        with ui.element("div").classes("ft-key") as self.box:
            choices = self._choices(materials)
            if choices is None:
                self.field: Any = ui.input(on_change=lambda: self._typed())
                self.field.props["debounce"] = TYPING_PAUSE_MS
                if "level" in self.key.param.kinds:
                    self.field.set_autocomplete(list(MESH_LEVEL_FACTORS))
            else:
                self.field = ui.select(choices, value="", on_change=lambda: self._typed())
            self._describe()
            self._show_unit()
            reset = ui.button(icon="restart_alt", on_click=lambda: self.change(self.key, None))
            reset.props("flat dense round size=sm").classes("ft-reset mt-1").tooltip("back to the default")
            reset.props["aria-label"] = f"reset {self.key.name}"
        if self.key.name == "material":
            self.box.classes("ft-wide")
        self._update_label()

    def _describe(self) -> None:
        """Name and meaning of the key for the eye, the keyboard and screen readers."""
        self.field.classes("w-full").props("outlined dense stack-label hide-bottom-space hide-hint")
        self.field.props["aria-label"] = self.key.dotted
        with self.field:
            self.tooltip = ui.tooltip()
        self._update_description()

    def _update_description(self) -> None:
        """Meaning and range of the key, in the unit of the field."""
        about = describe_key(self.key.param, self.unit)
        if about != self.field.props.get("hint"):
            self.field.props["aria-description"] = self.field.props["hint"] = about
            self.tooltip.text = f"{self.key.dotted}: {about}"

    def _show_unit(self) -> None:
        choices = unit_choices(self.key.param)
        self.unit_box: Any = None
        if len(choices) < 2:
            ui.label(unit_label(self.key.param.unit)).classes("ft-unit")
            return
        with ui.element("select").classes("ft-unit") as self.unit_box:
            for unit in choices:
                _UnitOption(unit)
        self.unit_box.props["aria-label"] = f"unit of {self.key.name}"
        self.unit_box.props["value"] = self.unit
        self.unit_box.on("change", lambda e: self._unit_chosen(str(e.args)), js_handler="e => emit(e.target.value)")

    def _choices(self, materials: Mapping[str, str]) -> dict[str, str] | None:
        """The values to choose from, with their texts; None for a field to type in."""
        param, default = self.key.param, self._default_text()
        if "flag" in param.kinds:
            words = {"true": "yes", "false": "no"}
            return {"": f"default: {words.get(default, default)}", **words}
        if "binding" in param.kinds:
            return {"": f"default: {default}", **{name: name for name in BINDINGS}}
        if self.key.name == "material":
            named = {name: f"{name}: {values}" for name, values in materials.items()}
            return {"": f"default: {named.get(default, default)}" if default else "choose a material", **named}
        return None

    def set_materials(self, materials: Mapping[str, str]) -> None:
        """Offer other materials."""
        if self.key.name == "material":
            options = self._choices(materials) or {}
            self._set_options(options)

    # --- value ------------------------------------------------------------------------------------------------
    def fill(self, stated: Any) -> None:
        """Show the value that the text states, None for the default; what is being typed stays as it is."""
        if stated == self.stated and isinstance(stated, bool) == isinstance(self.stated, bool):
            return
        self.stated = stated
        self.filling = True
        try:
            self._fill_field(stated)
        finally:
            self.filling = False
        self._update_label()

    def _fill_field(self, stated: Any) -> None:
        if isinstance(self.field, ui.select):
            value = "" if stated is None else format_value(stated)
            if value not in self.field.options:
                self._set_options({**self.field.options, value: escape_control(value)})
            self.field.value = value
            return
        text, unit = show_number(stated, self.key.param, self.unit)
        typed = read_number(self.field.value, self.key.param, self.unit)
        if typed == stated and isinstance(typed, bool) == isinstance(stated, bool):
            return  # the same value in other words, as "1." for 1
        self._set_unit(unit)
        self.field.value = text

    def _set_options(self, options: dict[str, str]) -> None:
        if options != self.field.options:
            self.field.set_options(options, value=self.field.value if self.field.value in options else "")

    def _typed(self) -> None:
        if self.filling:
            return
        if isinstance(self.field, ui.select):
            self.change(
                self.key, parse_value(self.field.value) if "flag" in self.key.param.kinds else self.field.value or None
            )
        else:
            self.change(self.key, read_number(self.field.value, self.key.param, self.unit))

    def _unit_chosen(self, unit: str) -> None:
        """Show the value in another unit; a value with its unit in the text is written in the new one."""
        if unit not in unit_choices(self.key.param):
            return
        stated = self.stated
        number = convert_to_key_unit(stated, self.key.param)
        self._set_unit(unit)
        self.filling = True
        self.field.value = show_number(number, self.key.param, unit)[0]
        self.filling = False
        self._update_label()
        if isinstance(stated, str) and isinstance(number, float):
            self.change(self.key, read_number(self.field.value, self.key.param, unit))

    def _set_unit(self, unit: str) -> None:
        self.unit = unit
        if self.unit_box is not None:
            self.unit_box.props["value"] = unit

    # --- marks ------------------------------------------------------------------------------------------------
    def _default_text(self) -> str:
        if self.key.param.value is None:
            return ""
        return show_number(self.key.param.value, self.key.param, self.unit)[0]

    def default_words(self) -> str:
        """The default with its unit, in words."""
        return describe_value(self.key.param.value, self.key.param, self.unit)

    def value_words(self) -> str:
        """The stated value with its unit, in words."""
        return describe_value(self.stated, self.key.param, self.unit)

    def _update_label(self) -> None:
        """Show the default as placeholder, and beside a changed value."""
        self._update_description()
        name = self.key.name.replace("_", " ")
        if name == "material" and self.key.table in ("block", "road"):
            name = f"{name} of the {self.key.table}"
        is_changed = self.is_changed
        set_prop(self.field, "label", f"{name} (default {self.default_words()})" if is_changed else name)
        marks = {"ft-changed": is_changed}
        if isinstance(self.field, ui.select):
            marks["ft-default"] = not self.field.value
        else:
            set_prop(self.field, "placeholder", self._default_text() or "not given")
        for mark, is_set in marks.items():
            if (mark in self.box.classes) != is_set:
                self.box.classes(toggle=mark)

    def set_fault(self, text: str) -> None:
        """Show an error at the field, "" for none."""
        if (self.field.error or "") != text:
            self.field.error = text or None


def describe_materials(raw: Mapping[str, Any]) -> dict[str, str]:
    """{name: values in words} of all materials that a case may name: its own and those of the library."""
    out = {name: _describe_material(material) for name, material in LIBRARY.items()}
    own = raw.get("materials")
    for name, table in own.items() if isinstance(own, dict) else ():
        values = table if isinstance(table, dict) else {}
        given = (values.get(k, "?") for k in ("conductivity", "density", "heat_capacity"))
        k, rho, c = (format_value(v) for v in given)
        out[escape_control(name)] = escape_control(f"{k} W/mK, {rho} kg/m³, {c} J/kgK, of this case")
    return out


def _describe_material(material: Material) -> str:
    return f"{material.conductivity:g} W/mK, {material.density:g} kg/m³, {material.heat_capacity:g} J/kgK"


class CaseForm:
    """All groups of keys with a search box; `change` is called with a key and its new value."""

    def __init__(self, change: Change, add_material: Callable[[], Any]):
        self.change, self.add_material = change, add_material
        self.fields: dict[str, KeyField] = {}
        self.groups: dict[str, tuple[Any, list[KeyField], bool, str]] = {}
        self.extra: list[str] = []
        self.materials: dict[str, str] = {}

    def show(self, raw: Mapping[str, Any]) -> None:
        """Show the groups with the values of a text."""
        self.materials = describe_materials(raw)
        self.search = ui.input("Search keys and their descriptions", on_change=lambda: self._search())
        self.search.props("outlined dense clearable debounce=150").classes("w-full")
        with self.search.add_slot("prepend"):
            ui.icon("search")
        self.none_found = ui.label("No key has these words.").classes("ft-muted")
        self.none_found.set_visibility(False)
        for group, keys in list_group_keys().items():
            self._add_group(group, keys, raw)
        self.extra_box = ui.column().classes("w-full gap-2")
        self._show_extra(raw)

    def _add_group(self, group: KeyGroup, keys: Iterable[CaseKey], raw: Mapping[str, Any]) -> None:
        fields = [KeyField(key, self.change) for key in keys]
        with ui.expansion(group.title, caption=group.about, value=group.is_usual).classes("ft-group") as box:
            with ui.element("div").classes("ft-keys"):
                for field in fields:
                    field.show(self.materials)
                    field.fill(stated_value(raw, field.key))
            if any(f.key.dotted == "block.material" for f in fields):
                add = ui.button("Add a material of your own", icon="add", on_click=self.add_material)
                add.props("flat dense color=primary").classes("mt-2")
        self.groups[group.title] = (box, fields, group.is_usual, group.about)
        self.fields |= {field.key.dotted: field for field in fields}

    def _show_extra(self, raw: Mapping[str, Any]) -> None:
        """Groups of the tables that only some cases have."""
        self.extra_box.clear()
        for table in self.extra:
            for key in [k for k in self.fields if k.rpartition(".")[0] == table]:
                del self.fields[key]
            self.groups.pop(table, None)
        self.extra = list_extra_tables(raw)
        with self.extra_box:
            for table in self.extra:
                kind, _, name = table.partition(".")
                title = f"{EXTRA_TITLES[kind]} {escape_control(name)}" if name else table
                self._add_group(KeyGroup(title, f"[{escape_control(table)}]", (table,)), table_keys(table), raw)
                self.groups[table] = self.groups.pop(title)

    def fill(self, raw: Mapping[str, Any]) -> None:
        """Show the values of a text."""
        if list_extra_tables(raw) != self.extra:
            self._show_extra(raw)
        if (materials := describe_materials(raw)) != self.materials:
            self.materials = materials
            for field in self.fields.values():
                field.set_materials(materials)
        for field in self.fields.values():
            field.fill(stated_value(raw, field.key))
        for box, fields, _, about in self.groups.values():
            changed = sum(field.is_changed for field in fields)
            set_prop(box, "caption", f"{about}; {changed} changed" if changed else about)

    def _search(self) -> None:
        """Show only the fields whose key or description has all words, with their groups open."""
        wanted = (self.search.value or "").strip()
        found = 0
        for box, fields, is_usual, _ in self.groups.values():
            visible = [field.key.contains_words(wanted) for field in fields]
            found += sum(visible)
            for field, is_visible in zip(fields, visible, strict=True):
                field.box.set_visibility(is_visible)
            box.set_visibility(any(visible))
            box.value = any(visible) if wanted else is_usual
        self.none_found.set_visibility(found == 0)
