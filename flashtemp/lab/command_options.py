"""Commands of the page of runs as the command line declares them: their file, words and options.

The command line passes these descriptions when it starts the web app (`cli.web_app`).
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

MAIN_COMMANDS = ("run", "compare", "discover", "plan", "sweep", "sensitivity")  # shown first, in this order
HELP_PARTS = re.compile(  # words to the first pause, a unit after a comma, and the rest
    r"(?P<words>.+?)(?:, (?P<unit>[^\s,;.=]{1,5})(?=[,;.]))?(?:[,;:.] (?P<rest>.+)|\.?)", re.DOTALL
)
OWN_FIELDS = ("out", "trust", "json", "resume")  # options for which the page has its own ways
ICONS = {
    "run": "play_arrow", "compare": "compare", "discover": "travel_explore", "plan": "science",
    "sweep": "grid_on", "sensitivity": "stacked_line_chart", "watch": "sensors",
}  # fmt: skip


@dataclass(frozen=True)
class CommandOption:
    """One option: `kind` is "switch", "choice" or "text"; a text is empty where it is left to the command."""

    name: str
    kind: str = "text"
    help: str = ""
    default: str = ""
    choices: tuple[str, ...] = ()
    required: bool = False

    @property
    def flag(self) -> str:
        """The option as a word of the command line.

        >>> CommandOption("skewness_cutoff").flag
        '--skewness-cutoff'
        """
        return "--" + self.name.replace("_", "-")

    @property
    def label(self) -> str:
        """What the option is, with its unit, in the words of its help.

        >>> CommandOption("limit", help="Memory limit, GB; 1 when not given.").label, CommandOption("dry_run").label
        ('Memory limit (GB)', 'dry run')
        """
        words, unit, _ = split_help(self.help)
        return (f"{words} ({unit})" if unit else words) or self.name.replace("_", " ")

    @property
    def hint(self) -> str:
        """What its help says in addition to the label."""
        return split_help(self.help)[2]


def split_help(text: str) -> tuple[str, str, str]:
    """(what is given, its unit, what else is to know) of a help text of the command line.

    >>> split_help("Sliding speeds, m/s."), split_help("Also write a .pvd series for older ParaView.")
    (('Sliding speeds', 'm/s', ''), ('Also write a .pvd series for older ParaView', '', ''))
    >>> split_help("Nominal pressures, Pa, in ascending order."), split_help("Views, separated by commas: wake.")
    (('Nominal pressures', 'Pa', 'in ascending order'), ('Views', '', 'separated by commas: wake'))
    """
    found = HELP_PARTS.fullmatch(text.strip())
    if found is None:
        return text, "", ""
    unit = (found["unit"] or "").replace("degC", "°C")
    return found["words"], unit, (found["rest"] or "").strip(" .")


@dataclass(frozen=True)
class CommandDescription:
    """A command: what it does in a `sentence`, the kind of its file (case or campaign), further words, options.

    `has_folder`: a folder of camera files stands before its file.
    """

    name: str
    sentence: str = ""
    file_kind: str = "case"
    words_label: str = ""
    words_help: str = ""
    options: tuple[CommandOption, ...] = ()
    has_folder: bool = False

    @property
    def icon(self) -> str:
        """The name of its symbol."""
        return ICONS.get(self.name, "terminal")

    @property
    def fields(self) -> tuple[CommandOption, ...]:
        """The options that have a field in the form."""
        return tuple(option for option in self.options if option.name not in OWN_FIELDS)


DEFAULT_COMMANDS = tuple(  # where the command line passes none: without options
    CommandDescription(name, file_kind="campaign" if name in ("compare", "discover", "plan") else "case")
    for name in MAIN_COMMANDS
)


def sort_commands(commands: Sequence[CommandDescription]) -> dict[str, CommandDescription]:
    """Commands by name, the main ones first."""
    first = {name: k for k, name in enumerate(MAIN_COMMANDS)}
    return {c.name: c for c in sorted(commands or DEFAULT_COMMANDS, key=lambda c: first.get(c.name, len(first)))}


def option_words(options: Sequence[CommandOption], values: Mapping[str, str | bool]) -> list[str]:
    """The words of a command line for the values of fields; values equal to the default are left out.

    >>> option_words([CommandOption("pvd", "switch"), CommandOption("workers")], {"pvd": True, "workers": " 2"})
    ['--pvd', '--workers', '2']
    >>> option_words([CommandOption("hide", required=True)], {"hide": "-x"})
    ['--hide=-x']
    """
    words = []
    for option in options:
        value = values.get(option.name, "")
        if option.kind == "switch":
            words += [option.flag] if value is True else []
            continue
        text = str(value or "").strip()
        if text and (option.required or text != option.default):
            words += [f"{option.flag}={text}"] if text.startswith("-") else [option.flag, text]
    return words


@dataclass(frozen=True)
class FilledForm:
    """The content of the form: `file`, further `words`, `values` of options, folder `out`, and `more` arguments.

    `arrivals` is the folder of camera files of a command that has one.
    """

    command: str
    file: str = ""
    words: str = ""
    values: Mapping[str, str | bool] | None = None
    out: str = ""
    more: str = ""
    arrivals: str = ""


def fill_form(words: Sequence[str], commands: Mapping[str, CommandDescription]) -> FilledForm:
    """The form that yields a command line; what no field can hold is in `more`.

    >>> commands = {"run": CommandDescription("run", words_label="keys", options=(CommandOption("pvd", "switch"),))}
    >>> form = fill_form(["run", "a.toml", "friction.mu=0.8", "--pvd", "--out", "b", "--log", "c"], commands)
    >>> form.file, form.words, form.values, form.out, form.more
    ('a.toml', 'friction.mu=0.8', {'pvd': True}, 'b', '--log c')
    """
    command = commands.get(words[0]) if words else None
    if command is None or len(words) < 2 or words[1].startswith("-"):
        return FilledForm(words[0] if command else next(iter(commands)), more=shlex.join(words[1:]) if command else "")
    first = 2 if command.has_folder else 1  # place of the file
    if len(words) <= first or words[first].startswith("-"):
        return FilledForm(words[0], more=shlex.join(words[1:]))
    by_flag = {option.flag: option for option in command.fields}
    values: dict[str, str | bool] = {}
    own, more, out, rest = [], [], "", list(words[first + 1 :])
    while rest:
        word = rest.pop(0)
        flag, has_value, value = word.partition("=")
        option = by_flag.get(flag)
        if option is not None and option.kind == "switch" and not has_value:
            values[option.name] = True
        elif (option is not None and option.kind != "switch") or flag == "--out":
            value = value if has_value else rest.pop(0) if rest else ""
            if option is None:
                out = value
            else:
                values[option.name] = value
        elif word.startswith("-"):
            more += [word, *([rest.pop(0)] if not has_value and rest and not rest[0].startswith("-") else [])]
        elif command.words_label:
            own.append(word)
        else:
            more.append(word)
    arrivals = words[1] if command.has_folder else ""
    return FilledForm(words[0], words[first], shlex.join(own), values, out, shlex.join(more), arrivals)


def find_risky_words(words: Sequence[str], commands: Mapping[str, CommandDescription]) -> list[str]:
    """Words of a command from a stranger's log that must not run by one click: `--log`, `--scheduler`, `--trust` ...

    A known command with its file, keys and fields has none.  Connections and absolute or upward paths are risky.
    """
    form = fill_form(words, commands)
    if not words or words[0] not in commands:
        return list(words[:1]) or ["no command"]
    risky = shlex.split(form.more)
    if risky[:1] == ["--resume"] and len(risky) == 2:
        risky = []
    values = {k: v for k, v in (form.values or {}).items() if isinstance(v, str)}
    risky += [f"--{name}" for name, value in values.items() if name == "scheduler" or _leads_out(value)]
    return risky + [word for word in (*shlex.split(form.words), form.file, form.out, form.arrivals) if _leads_out(word)]


def _leads_out(word: str) -> bool:
    """Whether a word, or the value of a key, is a path that leads out of the folder."""
    values = [word, *word.partition("=")[2].split(",")]
    return any(v.strip(" \"'[").startswith(("/", "~", "\\")) or ".." in Path(v).parts or "://" in v for v in values)
