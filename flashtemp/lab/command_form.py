"""The form for a command: its card, its file, its options, further arguments, and the command line that they make."""

from __future__ import annotations

import shlex
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from flashtemp.lab.command_options import (
    MAIN_COMMANDS,
    CommandDescription,
    CommandOption,
    FilledForm,
    fill_form,
    option_words,
    sort_commands,
    split_help,
)
from flashtemp.lab.examples import list_examples, write_example
from flashtemp.lab.job_record import LoggedJob, format_duration
from flashtemp.lab.job_result import choose_result_folder, free_result_folder
from flashtemp.lab.job_start import check_job_words, file_word, short_file_name
from flashtemp.lab.jobs import command_text
from flashtemp.lab.page_layout import (
    action,
    card,
    note,
    page_address,
    program_lines,
    show_command,
    show_errors,
)
from flashtemp.lab.programs import has_trust, programs_of_command
from flashtemp.lab.start_button import start_once
from flashtemp.lab.workspace import escape_control, list_folder, list_image_folders, read_owner, resolve_inside


class CommandForm:
    """The form on the page of runs; `start` is called with the words of the command."""

    def __init__(
        self,
        folder: Path,
        commands: Sequence[CommandDescription] = (),
        start: Callable[[list[str]], Awaitable[bool]] | None = None,
        past: Callable[[], Sequence[LoggedJob]] = tuple,
    ):
        self.folder, self.commands, self.start_command, self.past = folder, sort_commands(commands), start, past
        self.fields: dict[str, Any] = {}
        self.command: Any = None
        self.of: Any = None
        self.arrivals: Any = None
        self.words: Any = None
        self.out: Any = None
        self.more: Any = None
        self.resumed = ""

    def show(self, command: str, of: str, repeated: Sequence[str] = ()) -> None:
        """Show the form with a command and its file, or with the content of a command line that is `repeated`."""
        filled = fill_form(repeated, self.commands) if repeated else FilledForm("", of)
        owner = None
        if of:
            with show_errors(self.folder):
                owner = read_owner(resolve_inside(self.folder, of))
        self.resumed = of if owner is not None and owner.command == "run" else ""
        chosen = filled.command or (command if command in self.commands else next(iter(self.commands)))
        with card("Start a command"):
            self.command = _CommandCards(self.commands, chosen, self._command_changed)
            self.place = ui.element("div").classes("ft-fields")
            self.fold = ui.expansion("Further arguments").classes("w-full").props("dense")
            with self.fold:
                self.more = ui.input("further arguments: table.key=value, options", on_change=self._show_command)
                self.more.props("outlined dense").classes("w-full").value = filled.more
            self.fold.value = bool(filled.more)
            self.line = ui.column().classes("w-full gap-2")
            with ui.row().classes("items-center gap-3"):
                self.button = action("Start", start_once(self._start), icon="play_arrow", main=True)
                self.estimate = ui.label().classes("ft-muted ft-small")
        self._show_fields(filled)
        self._show_command()

    # --- fields ---------------------------------------------------------------------------------------
    def _show_fields(self, filled: FilledForm) -> None:
        """Show the fields of the chosen command with their content."""
        about = self.commands[self.command.value]
        self.place.clear()
        self.fields = {}
        with self.place:
            choices = self._file_choices(about, filled.file)
            names = {name: escape_control(name) for name in choices}
            with _labelled_field(about.file_kind.capitalize(), "", wide=True) as label:
                self.of = ui.select(names, value=filled.file or None, with_input=True)
                self.of.props("outlined dense").on_value_change(self._show_command)
                label.props["for"] = self.of.html_id
            self.arrivals = self._show_folder(filled.arrivals) if about.has_folder else None
            self.words = None
            if about.words_label:
                words, _, hint = split_help(about.words_help)
                with _labelled_field(words, hint, wide=True) as label:
                    self.words = ui.input(value=filled.words, on_change=self._show_command)
                    self.words.props("outlined dense")
                    label.props["for"] = self.words.html_id
            values = filled.values or {}
            with _labelled_field("Result folder", "") as label:
                self.out = ui.input(value=filled.out and self._free_out(filled.out))
                self.out.on_value_change(self._show_command)
                self.out.props('outlined dense placeholder="chosen for you"')
                label.props["for"] = self.out.html_id
            for option in sorted(about.fields, key=lambda one: (not one.required, one.kind == "switch")):
                self.fields[option.name] = self._show_option(option, values.get(option.name))
        if not choices:
            with self.place:
                self._show_missing_files(about)

    def _show_folder(self, chosen: str) -> Any:
        """The field for the folder in which camera files arrive."""
        names = list(dict.fromkeys([*([chosen] if chosen else []), *list_image_folders(self.folder)]))
        options = {name: escape_control(name) for name in names}
        with _labelled_field("Folder of camera files (required)", "", wide=True) as label:
            field = ui.select(options, value=chosen or None, with_input=True)
            field.props("outlined dense").on_value_change(self._show_command)
            label.props["for"] = field.html_id
        return field

    def _show_option(self, option: CommandOption, value: str | bool | None) -> Any:
        """One field of an option with what its help says; the option of the command line is shown on hover."""
        title = option.label + (" (required)" if option.required else "")
        if option.kind == "switch":
            with ui.element("div").classes("ft-option"):
                field = ui.checkbox(title, value=value is True).props("dense").tooltip(option.flag)
                _show_hint(option.hint)
        else:
            with _labelled_field(title, option.hint) as label:
                if option.kind == "choice":
                    field = ui.select(list(option.choices), value=value or option.default)
                else:
                    field = ui.input(value=str(value or option.default))
                field.props("outlined dense")
                label.props["for"] = field.html_id
                label.tooltip(option.flag)
        field.on_value_change(self._show_command)
        return field

    def _show_missing_files(self, about: CommandDescription) -> None:
        """Say what the command needs and how to get it."""
        how = {
            "case": "This folder has no case yet. A case states block, road, contact and schedule.",
            "campaign": "This folder has no campaign yet. A campaign lists recordings and the case that they test.",
        }[about.file_kind]
        with ui.element("div").classes("ft-note wide"):
            ui.label(how)
            with ui.row().classes("gap-2 q-mt-sm"):
                action(f"New {about.file_kind}", lambda: ui.navigate.to(page_address(about.file_kind)))
                if about.file_kind == "case":
                    action("Write an example", self._write_example)

    def _write_example(self) -> None:
        """Write the case of an example into the folder, and choose it."""
        example = list_examples()[0]
        with self.line, show_errors(self.folder):
            name = write_example(example, self.folder)
            changes = " ".join(word for word in example.command if "=" in word)
            self._show_fields(FilledForm(self.command.value, name, changes))
            self._show_command()

    def _file_choices(self, about: CommandDescription, of: str) -> list[str]:
        """The files that the command accepts."""
        listing = list_folder(self.folder)
        kind = listing.campaigns if about.file_kind == "campaign" else listing.cases
        names = [short_file_name(p) for p in kind]
        return list(dict.fromkeys([*([of] if of else []), *names]))

    def _command_changed(self) -> None:
        """Offer the fields of the newly selected command; a file of the same kind stays chosen."""
        self.resumed = ""
        about, of = self.commands[self.command.value], self.of.value or ""
        self._show_fields(FilledForm(about.name, of if of in self._file_choices(about, "") else ""))
        self._show_command()

    def _free_out(self, out: str) -> str:
        """A result folder of that name that does not exist yet."""
        with show_errors(self.folder):
            resolve_inside(self.folder, out)
            return free_result_folder(self.folder, out, self.past())
        return ""

    # --- command line ---------------------------------------------------------------------------------
    def command_words(self) -> list[str]:
        """The command line without `flashtemp`, with a free result folder where `--out` is not given."""
        if self.resumed and self.of.value == self.resumed:
            return ["run", "--resume", file_word(self.resumed)]
        command, of, more = self.command.value, file_word(self.of.value or ""), shlex.split(self.more.value or "")
        if more[:1] == ["--resume"] and not of:
            return [command, *more]
        if not of or (self.arrivals is not None and not self.arrivals.value):
            return []
        words = shlex.split(self.words.value or "") if self.words is not None else []
        about = self.commands[command]
        options = option_words(about.fields, {name: field.value for name, field in self.fields.items()})
        out = (self.out.value or "").strip() if self.out is not None else ""
        if not out and not any(word == "--out" or word.startswith("--out=") for word in more):
            out = choose_result_folder(self.folder, command, of, self.past())
        folder = [file_word(self.arrivals.value)] if self.arrivals is not None else []
        return [command, *folder, of, *words, *options, *more, *(["--out", file_word(out)] if out else [])]

    def _missing_options(self) -> list[str]:
        """Labels of the required options that are empty."""
        options = self.commands[self.command.value].fields
        return [o.label for o in options if o.required and not str(self.fields[o.name].value or "").strip()]

    def _show_command(self) -> None:
        """Show the command line and the effect files that it would run."""
        self.line.clear()
        with self.line, show_errors(self.folder):
            try:
                words = self.command_words()
            except ValueError as fault:  # an unclosed quote
                ui.label(str(fault))
                words = []
            missing = self._missing_options() if words and not self.resumed else []
            self.button.set_enabled(bool(words) and not missing)
            self.estimate.text = ""
            if not words:
                note("Choose a file: the command line is shown here.")
                return
            check_job_words(self.folder, words)
            show_command(command_text(words))
            if missing:
                note(f"Give a value for: {'; '.join(missing)}.", "warning")
            self._show_programs(words)
            self.estimate.text = estimate_time(words, self.past())

    def _show_programs(self, words: list[str]) -> None:
        programs, trust = programs_of_command(words, self.folder), has_trust(words)
        for line in program_lines(programs, trust) if programs or trust else ():
            note(line, "warning")

    async def _start(self) -> bool:
        """Start the command of the form; whether it was started."""
        with self.line, show_errors(self.folder):
            if self.start_command is not None and await self.start_command(self.command_words()):
                if self.out is not None:
                    self.out.value = ""
                self._show_command()
                return True
        return False


class _CommandCards:
    """Cards of which one is chosen: the main commands, and the others behind a switch; `value` is the chosen name."""

    def __init__(self, commands: dict[str, CommandDescription], value: str, on_change: Callable[[], None]):
        self.value, self.on_change, self.cards = value, on_change, dict[str, Any]()
        others = {n: c for n, c in commands.items() if n not in MAIN_COMMANDS}
        with ui.element("div").props('role=radiogroup aria-label="command"').classes("w-full"):
            with ui.element("div").classes("ft-choices"):
                for name, about in commands.items():
                    if name not in others:
                        self._add_card(about)
            if others:
                fold = ui.expansion("More commands", value=value in others).props("dense").classes("w-full")
                with fold, ui.element("div").classes("ft-choices"):
                    for about in others.values():
                        self._add_card(about)

    def _add_card(self, about: CommandDescription) -> None:
        button = ui.element("button").classes("ft-choice").on("click", lambda name=about.name: self._choose(name))
        button.props("type=button role=radio")
        button.props["aria-checked"] = "true" if about.name == self.value else "false"
        with button:
            ui.icon(about.icon).props("aria-hidden=true")
            TextElement(tag="b", text=about.name)
            TextElement(tag="span", text=escape_control(about.sentence))
        self.cards[about.name] = button

    def _choose(self, name: str) -> None:
        self.cards[self.value].props("aria-checked=false")
        self.value = name
        self.cards[name].props("aria-checked=true")
        self.on_change()


@contextmanager
def _labelled_field(label: str, hint: str, wide: bool = False) -> Iterator[Any]:
    """Context manager: a field below its label, with a hint below it; yields the label."""
    with ui.element("div").classes("ft-option wide" if wide else "ft-option"):
        yield TextElement(tag="label", text=escape_control(label))
        _show_hint(hint)


def _show_hint(hint: str) -> None:
    if hint:
        ui.label(escape_control(hint)).classes("ft-muted ft-small")


def estimate_time(words: Sequence[str], past: Sequence[LoggedJob]) -> str:
    """How long the command took last time with the same file, in words; empty where it never ended."""
    for exact in (True, False):
        for job in past:
            is_same = job.words[:2] == tuple(words[:2]) and (not exact or _key_words(job.words) == _key_words(words))
            if is_same and job.exit_code == 0 and (seconds := job.seconds) is not None:
                change = "" if exact else ", with other arguments"
                return f"Took {format_duration(seconds)} last time{change}."
    return ""


def _key_words(words: Sequence[str]) -> list[str]:
    """The words that decide how long a command takes: all but those of the result folder."""
    return [w for k, w in enumerate(words) if w != "--out" and (k == 0 or words[k - 1] != "--out")]
