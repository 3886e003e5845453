"""The command `lab`: serve the web app, with forms made from the declarations of the other commands."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from cyclopts import App, Parameter

from flashtemp.cli import campaigns, friction, simulate, studies
from flashtemp.cli.terminal import EXIT_DONE, print_message
from flashtemp.lab.command_options import CommandDescription, CommandOption

COMMAND_MODULES = (simulate, campaigns, studies, friction)
FILE_KINDS = ("case", "campaign")  # names of a first argument that the page can choose from the folder


def lab(
    folder: Path = Path(),
    /,
    *,
    browser: Annotated[bool, Parameter(negative="--no-browser", help="Open the page in the browser.")] = True,
) -> int:
    """Open the web app in the browser: camera files, cases, runs and verdicts of a folder.

    Parameters
    ----------
    folder
        Folder with your files; the current folder when not given.
    """
    from flashtemp.lab.server import serve

    def print_address(address: str) -> None:
        print_message("stop with Ctrl-C; running commands save a checkpoint first")
        print(address, flush=True)

    serve(folder, browser, print_address, describe_commands())
    return EXIT_DONE


def describe_commands() -> tuple[CommandDescription, ...]:
    """Descriptions of all commands that take a case or a campaign and write a result folder."""
    return tuple(
        describe_command(function, words[k], has_folder=k == 1)
        for module in COMMAND_MODULES
        for function in vars(module).values()
        if inspect.isfunction(function) and function.__module__ == module.__name__
        if (words := list(inspect.signature(function).parameters)) and "out" in words
        if words[k := int(words[0] == "folder")] in FILE_KINDS
    )


def describe_command(function: Callable[..., Any], file_kind: str, has_folder: bool = False) -> CommandDescription:
    """The description of the command of a function whose first argument, or second after a folder, is such a file."""
    app, name = App(), function.__name__.rstrip("_")
    app.command(function, name=name)
    command = app[name]
    sentence = " ".join(command.help.split("\n\n")[0].split())
    options, label, words_help = [], "", ""
    for argument in command.assemble_argument_collection(parse_docstring=True):
        kind, text = argument.field_info.kind, " ".join((argument.parameter.help or "").split())
        if kind is inspect.Parameter.VAR_POSITIONAL:
            label, words_help = argument.name.lower(), text
        elif kind is inspect.Parameter.KEYWORD_ONLY:
            options.append(_describe_option(argument, text))
    return CommandDescription(name, sentence, file_kind, label, words_help, tuple(options), has_folder)


def _describe_option(argument: Any, text: str) -> CommandOption:
    """The description of one option with its help `text`."""
    default, hint = argument.field_info.default, argument.hint
    required = default is inspect.Parameter.empty
    choices = tuple(map(str, get_args(hint))) if get_origin(hint) is Literal else ()
    kind = "switch" if hint is bool else "choice" if choices else "text"
    shown = "" if required or default is None or kind == "switch" else str(default)
    name = argument.name.removeprefix("--").replace("-", "_")
    return CommandOption(name, kind, text, shown, choices, required)
