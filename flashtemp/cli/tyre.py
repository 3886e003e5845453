"""Commands for rolling rubber: tread, one tread block in its footprint; tyre, side force over slip angle."""

from __future__ import annotations

from pathlib import Path

from flashtemp.cli.terminal import EXIT_DONE, Json, Trust, print_result, progress_counter, result_folder


def tread(case: str, /, *overrides: str, out: Path | None = None, trust: Trust = False, json: Json = False) -> int:
    """Compute the friction of one tread block along its footprint, from the cold to the hot branch, at several slips.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tread] describes the block and the footprint.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tread when not given.
    """
    from flashtemp.api import friction, inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    folder = result_folder(out, f"{loaded.name}-tread")
    with progress_counter(loaded.name) as watch:
        found = friction.tread(loaded, out=folder, watch=watch)
    print_result(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
    return EXIT_DONE


def tyre(case: str, /, *overrides: str, out: Path | None = None, trust: Trust = False, json: Json = False) -> int:
    """Compute the side force of a tyre over slip angle at several loads, with the cold-hot law and its controls.

    Parameters
    ----------
    case
        A case folder or a .toml file; its table [tyre] describes the footprint and the bristles.
    overrides
        Keys of the case to change, as table.key=value.
    out
        Result folder; results/CASE-tyre when not given.
    """
    from flashtemp.api import friction, inputs

    loaded = inputs.load(case, list(overrides), trust=trust)
    folder = result_folder(out, f"{loaded.name}-tyre")
    with progress_counter(loaded.name) as watch:
        found = friction.tyre(loaded, out=folder, watch=watch)
    print_result(found.as_dict() | {"out": str(folder)}, json, f"{found}\n  results in {folder}/")
    return EXIT_DONE
