"""The page of runs: start a command, watch those that run, and find, repeat or change those of the past."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from nicegui import ui

from flashtemp.lab.command_form import CommandForm
from flashtemp.lab.command_options import CommandDescription, find_risky_words, sort_commands
from flashtemp.lab.job_cards import JobCard, show_job_heading, show_past_job
from flashtemp.lab.job_record import LoggedJob
from flashtemp.lab.job_result import free_result_folder, result_name
from flashtemp.lab.job_start import start_job
from flashtemp.lab.jobs import LOG_FOLDER, Job, JobList
from flashtemp.lab.page_layout import (
    add_script,
    card,
    empty_state,
    heading,
    note,
    page_address,
    script_literal,
    show_error,
)
from flashtemp.lab.programs import AllowedPrograms
from flashtemp.lab.style import read_asset
from flashtemp.lab.workspace import escape_control

REFRESH_INTERVAL_S = 0.5  # of the job cards
MAX_PAST_JOBS, PAST_JOBS_SHOWN = 200, 12
PAGE_NAME = "Runs · flashtemp"


class JobsPage:
    """The form for a command, the cards of running commands with live pictures, and the history."""

    def __init__(
        self, folder: Path, jobs: JobList, allowed: AllowedPrograms, commands: Sequence[CommandDescription] = ()
    ):
        self.folder, self.jobs, self.allowed = folder, jobs, allowed
        self.commands = sort_commands(commands)
        self.cards: dict[str, JobCard] = {}
        self.title, self.is_detail = PAGE_NAME, False
        self.past: list[LoggedJob] = []
        self.form = CommandForm(folder, commands, self.start, lambda: [*jobs.all, *self.past])

    async def show(self, command: str, of: str, job: str = "", again: str = "") -> None:
        """Show the page with a command and its file, one `job` in detail, or the form as filled in for `again`."""
        ui.add_css(read_asset("runs.css"))
        add_script("charts.js")  # charts are added later, when scripts do not run
        self.is_detail = bool(job)
        if job:
            self._show_job(job)
            return
        self.past = self.jobs.list_past(MAX_PAST_JOBS)
        repeated = self.jobs.find_job(again) if again else None
        if again and repeated is None:
            show_error("No such job in the history of this folder.")
        elif repeated is not None and (risky := find_risky_words(repeated.words, self.commands)):
            words = "This command is from a log in this folder. Check before you start it: "
            note(words + ", ".join(dict.fromkeys(risky)), "warning")
        self.running = ui.column().classes("w-full gap-4 items-stretch")
        self.running.set_visibility(False)
        self.form.show(command, of, repeated.words if repeated is not None else ())
        self.opened = {one.name for one in self.jobs.all if not one.is_unfinished}  # ended before: in the history
        with card("History"):
            self._show_history()
        self._refresh_cards()
        ui.timer(REFRESH_INTERVAL_S, self._refresh_cards)

    # --- running jobs -------------------------------------------------------------------------------------
    def _refresh_cards(self) -> None:
        """Add cards of new jobs, update all, and show the progress of the newest in the title of the page."""
        for job in reversed(self.jobs.all):
            if job.name not in self.cards and job.name not in self.opened:
                self._add_card(job)
        for one in self.cards.values():
            one.refresh()
        self._show_title(next((job for job in self.jobs.all if job.is_running), None))

    def _add_card(self, job: Job) -> None:
        self.running.set_visibility(True)
        with self.running:
            self.cards[job.name] = JobCard(self.folder, job, self.start)
        self.cards[job.name].card.move(target_index=0)
        ui.run_javascript("window.scrollTo({top: 0})")

    def _show_title(self, job: LoggedJob | None) -> None:
        """Show the progress of a job in the title of the page, as "42 % · run_in"."""
        title = PAGE_NAME
        if job is not None:
            fraction, _ = job.progress()
            name = Path(job.words[1]).name if len(job.words) > 1 else job.words[0]
            name = Path(job.words[2]).name if name == "--resume" and len(job.words) > 2 else name
            title = f"{'…' if fraction is None else f'{100 * fraction:.0f} %'} · {escape_control(name)}"
        if title != self.title:
            self.title = title
            ui.run_javascript(f"document.title = {script_literal(title)}")

    # --- history ------------------------------------------------------------------------------------------
    def _show_history(self) -> None:
        """Rows of all jobs that had ended when the page was opened, also those of earlier servers."""
        ended = [job for job in self.jobs.all if job.name in self.opened]
        past = sorted([*ended, *self.past], key=lambda job: job.name, reverse=True)
        if not past:
            ui.label(
                "No earlier command in this folder. Each one that you start stays listed here with its log, its "
                "result and its command line, also after the server ends."
            ).classes("ft-muted")
            return
        ui.label(
            f"At most {self.jobs.most_at_once} commands run at once; others wait for their turn."
            f" Logs are kept in {LOG_FOLDER}/."
        ).classes("ft-muted ft-small")
        rows = ui.column().classes("w-full gap-0")

        def show_rows(jobs: Sequence[LoggedJob]) -> None:
            with rows:
                for job in jobs:
                    show_past_job(self.folder, job, self.start)

        show_rows(past[:PAST_JOBS_SHOWN])
        if len(past) > PAST_JOBS_SHOWN:
            rest = ui.button(f"Show {len(past) - PAST_JOBS_SHOWN} more").props("flat no-caps")

            def show_rest() -> None:
                show_rows(past[PAST_JOBS_SHOWN:])
                rest.delete()

            rest.on_click(show_rest)

    # --- one job ------------------------------------------------------------------------------------------
    def _show_job(self, name: str) -> None:
        """One job in detail: command line, live pictures, result and log."""
        job = self.jobs.find_job(name)
        if job is None:
            heading(1, "No such job")
            with empty_state("This folder has no job of that name", "Its log may have been removed."):
                ui.link("All runs", page_address("runs"))
            return
        words = [word for word in job.words[1:2] if not word.startswith("-")] or [result_name(job.words)]
        heading(1, f"{job.words[0]} {words[0]}")
        ui.link("← All runs", page_address("runs")).classes("ft-small")
        show_job_heading(job)
        one = JobCard(self.folder, job, self.start, alone=True)

        def refresh() -> None:
            one.refresh()
            self._show_title(job if job.is_unfinished else None)

        ui.timer(REFRESH_INTERVAL_S, refresh)

    # --- starting -----------------------------------------------------------------------------------------
    async def start(self, words: list[str]) -> bool:
        """Start a command or repeat one of the past; whether it was started.  Raises BadInput.

        A command of a log may come from a stranger: one with risky words is shown in the form instead.
        """
        if self._is_repeated(words):
            if find_risky_words(words, self.commands):
                return False
            words = self._with_free_folder(words)
        is_started = await start_job(self.folder, self.jobs, self.allowed, words)
        if is_started and self.is_detail:
            ui.navigate.to(page_address("runs", job=self.jobs.all[0].name))
        return is_started

    def _is_repeated(self, words: list[str]) -> bool:
        """Whether a command is not the present content of the form."""
        try:
            return self.form.command is None or words != self.form.command_words()
        except ValueError:  # an unclosed quote in the form
            return True

    def _with_free_folder(self, words: list[str]) -> list[str]:
        """The command with a result folder that does not exist yet; one that continues a study keeps its own."""
        out, jobs = result_name(words), self.jobs.all
        is_taken = any(job.is_unfinished and result_name(job.words) == out for job in jobs)
        if not out or "--resume" in words or not (is_taken or (self.folder / out).exists()):
            return words
        free = free_result_folder(self.folder, out, jobs)
        changed = [f"--out={free}" if word.startswith("--out=") else word for word in words]
        if "--out" in changed:
            changed[changed.index("--out") + 1] = free
        return changed
