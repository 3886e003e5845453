"""The long attack on what a user has: kills, interrupts, full disks and damage at random moments and places."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from flashtemp.__main__ import main
from flashtemp.errors import BadInput
from flashtemp.runs.results import checkpoint

CASE = """title = "small"
effects = ["track_memory", "friction_softening"]
[block]
height = 0.005
[road]
track_length = 0.06
[schedule]
distance = {distance}
repetitions = 3
wait = 1.0
[numerics]
mesh = {mesh}
across = {across}
[output]
profiles = 8
fields = 4
animation = false
"""
KINDS = ("run in 2D", "run in 3D", "sweep", "discover")
MINE = "years of work"


class Forked:
    """A command in a child that is forked: what is asked of `subprocess.Popen` here, without the time to load."""

    def __init__(self, words: list[str], place: Path):
        self.said, self.returncode = tempfile.mkstemp(dir=place)[1], None
        self.pid = os.fork()
        if not self.pid:
            code = 99
            try:
                sink = os.open(self.said, os.O_WRONLY)
                os.dup2(sink, 1)
                os.dup2(sink, 2)
                sys.stdout, sys.stderr = (os.fdopen(os.dup(sink), "w", buffering=1) for _ in range(2))
                code = main(words)
            finally:
                os._exit(code)

    def send_signal(self, number: int) -> None:
        os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout: float = 600.0) -> tuple[str, str]:
        """What it printed on stdout and stderr together, once it has ended."""
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])
        return "", Path(self.said).read_text()


class Bench:
    """A folder with cases and a campaign, and what every command leaves when nobody disturbs it."""

    def __init__(self, place: Path):
        self.place, self.cases = place, {}
        for name, values in {"flat": (0.3, 0.4, 0), "deep": (0.06, 0.2, 8)}.items():
            folder = place / name
            folder.mkdir()
            across = f"{values[2]}" if values[2] else "0"
            text = CASE.format(distance=values[0], mesh=values[1], across=across)
            (folder / "case.toml").write_text(text if values[2] else text.replace("across = 0\n", ""))
            self.cases[name] = folder
        self.token = f"flashtemp-attack-{os.getpid()}"
        self.known, self.seconds = {}, {}
        os.environ |= {"OMP_NUM_THREADS": "1", "FLASHTEMP_ATTACK": self.token}  # of all that is begun from here

    @cached_property
    def campaign(self) -> Path:
        """A synthetic campaign with two candidates."""
        twin = ["schedule.repetitions=1", "schedule.distance=0.1", "--hide", "pressure_tilt", "--seed", "1"]
        folder = self.place / "campaign"
        less = ["--conditions", "2", "--views", "profile"]
        code, said = self.call(["twin", str(self.cases["flat"]), *twin, "--out", str(folder), *less])
        assert code == 0, said
        text = (folder / "campaign.toml").read_text()
        (folder / "campaign.toml").write_text('candidates = ["pressure_tilt", "camera_offset"]\n' + text)
        return folder

    def words(self, kind: str, out: Path) -> list[str]:
        """The command of a kind."""
        if kind in ("discover", "compare"):
            return [kind, str(self.campaign), *(["--workers", "2"] if kind == "discover" else []), "--out", str(out)]
        given = {
            "run in 2D": ["run", str(self.cases["flat"])],
            "run in 3D": ["run", str(self.cases["deep"]), "output.pictures=false"],
            "sweep": [
                "sweep",
                str(self.cases["flat"]),
                "friction.mu=0.5,0.6,0.7,0.8",
                "schedule.speed=0.1,0.2",
                "--workers",
                "2",
            ],
        }
        return [*given[kind], "--out", str(out)]

    def start(self, words: list[str], fresh: bool = True, **more):
        """A command that runs: in a `fresh` Python, or forked from this one, with all its modules loaded."""
        if not fresh:
            return Forked(words, self.place)
        command = [sys.executable, "-m", "flashtemp", *words]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)

    def call(self, words: list[str], fresh: bool = True, **more) -> tuple[int, str]:
        """Exit code and stderr of a command."""
        process = self.start(words, fresh, **more)
        said = process.communicate(timeout=600)[1]
        return process.returncode, said.strip()

    def reference(self, kind: str, fresh: bool = True) -> float:
        """Seconds that a command of a kind takes; what it leaves is known from then on."""
        if kind not in self.known:
            out = self.place / f"known-{kind.replace(' ', '-')}"
            self.call(self.words(kind, self.place / f"warm-{kind.replace(' ', '-')}"), fresh)
            began = time.monotonic()
            code, said = self.call(self.words(kind, out), fresh)
            assert code == 0, said
            self.seconds[kind] = time.monotonic() - began
            self.known[kind] = answer(out)
        return self.seconds[kind]

    def right(self, kind: str, out: Path) -> str:
        """What is wrong with a result; nothing where it is that of the undisturbed command."""
        try:
            found, known = answer(out), self.known[kind]
        except (OSError, ValueError, KeyError) as fault:
            return f"{kind}: cannot be read: {fault!r}"
        if found.keys() != known.keys():
            return f"{kind}: {sorted(found.keys() ^ known.keys())}"
        for name, values in known.items():
            if isinstance(values, str):
                same = values == found[name]
                if not same:
                    return f"{kind}: {sorted(set(values.split()) ^ set(found[name].split()))}"
            else:
                scale = max(1e-3, float(np.nanmax(np.abs(values - np.nanmin(values)))))
                same = values.shape == found[name].shape and np.allclose(
                    found[name], values, atol=2e-3 * scale, equal_nan=True
                )
            if not same:
                return f"{kind}: {name} differs"
        return ""

    def strays(self) -> list[int]:
        """Processes that our commands have left behind."""
        mark, found = f"FLASHTEMP_ATTACK={self.token}".encode(), []
        for pid in (p.name for p in Path("/proc").iterdir() if p.name.isdigit()):
            try:
                stat = Path(f"/proc/{pid}/stat").read_text()
                if stat.rpartition(")")[2].split()[0] != "Z" and mark in Path(f"/proc/{pid}/environ").read_bytes():
                    found.append(int(pid))
            except OSError:
                continue
        return found

    def alone(self) -> str:
        """What is still running some seconds after a command has gone; nothing where all went with it."""
        end = time.monotonic() + 5.0
        while (left := self.strays()) and time.monotonic() < end:
            time.sleep(0.1)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        return f"{len(left)} processes left behind" if left else ""


def answer(out: Path) -> dict:
    """The numbers of a result, and the names of its files."""
    files = " ".join(sorted(p.name for p in out.iterdir() if p.is_file()))
    if (out / "verdict.json").is_file():
        verdict = json.loads((out / "verdict.json").read_text())
        return {"files": files, "verdict": verdict["verdict"], "chi2": np.array(verdict["base"]["chi2_per_dof"])}
    if (out / "compare.json").is_file():
        found = json.loads((out / "compare.json").read_text())
        return {"files": files, "rmse": np.array([r["rmse_K"] for r in found["recordings"]])}
    name = "sweep.nc" if (out / "sweep.nc").is_file() else "run.nc"
    with xr.open_dataset(out / name) as ds:
        shown = ("time", "T_block", "T_spot", "T_road", "pressure", "slid", "rise_trailing_K", "friction")
        return {"files": files} | {k: ds[k].values.astype(float) for k in shown if k in ds.variables}


@contextmanager
def bench():
    """A bench in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="attack-") as place:
        made = Bench(Path(place))
        yield made
        made.alone()


def tries(row, seed: int, share: float, count: int, one: Callable) -> None:
    """`one(rng)` -> (outcome, fault), `count` times a share, each with its own numbers."""
    for k in range(max(1, round(share * count))):
        rng = np.random.default_rng([seed, k, sum(row.name.encode())])
        outcome, fault = one(rng)
        row.count(outcome, f"try {k}: {fault}" if fault else "")


def clean_words(said: str) -> str:
    return "a traceback" if "Traceback" in said or "Exception ignored" in said else ""


def killed(kind: str) -> Callable:
    """kill -9 at a random moment: absent, whole, or resumable and right."""

    def attack(row, seed: int, share: float) -> None:
        with bench() as b:
            main(["check", str(b.cases["flat"])])  # loads what the children share
            whole = b.reference(kind, fresh=False)

            def one(rng) -> tuple[str, str]:
                place = Path(tempfile.mkdtemp(dir=b.place))
                process = b.start(b.words(kind, place / "a"), fresh=False)
                time.sleep(rng.uniform(0.0, 1.05) * whole)
                process.kill()
                process.communicate()
                left = b.alone()
                outcome, fault = after_kill(b, kind, place)
                shutil.rmtree(place)
                return outcome, left or fault

            tries(row, seed, share, 50, one)

    return attack


def after_kill(b: Bench, kind: str, place: Path) -> tuple[str, str]:
    out = place / "a"
    if out.exists():
        return "whole", b.right(kind, out)
    waiting = [p for p in place.glob("a.partial*") if (p / "checkpoint.h5").is_file() or (p / "sweep.json").is_file()]
    again = ["run", "--resume", str(out)] if waiting and kind.startswith("run") else b.words(kind, out)
    code, said = b.call(again, fresh=False)
    fault = clean_words(said) or (f"exit {code}: {said}" if code else b.right(kind, out))
    return ("resumed" if waiting else "absent, then run anew"), fault


def stopped(number: int) -> Callable:
    """Ctrl-C or SIGTERM at a random moment, after Python itself has started: one line, exit 130, nothing left behind."""

    def attack(row, seed: int, share: float) -> None:
        with bench() as b:
            kinds = (*KINDS, "compare")
            for kind in kinds:
                b.reference(kind)

            def one(rng) -> tuple[str, str]:
                kind = kinds[rng.integers(len(kinds))]
                place = Path(tempfile.mkdtemp(dir=b.place))
                process = b.start(b.words(kind, place / "a"), start_new_session=True)
                time.sleep(rng.uniform(0.15, 1.0) * b.seconds[kind])
                # a terminal's Ctrl-C reaches the workers too
                (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
                try:
                    said = process.communicate(timeout=60)[1].strip()
                except subprocess.TimeoutExpired:
                    process.kill()
                    return "hangs", f"{kind} does not end"
                fault = clean_words(said) or b.alone()
                if not fault and process.returncode == 0:
                    outcome, fault = "finished", b.right(kind, place / "a")
                elif not fault:
                    good = process.returncode == 130 and said.splitlines()[-1].startswith("interrupted")
                    outcome, fault = after_stop(b, kind, place) if good else ("", f"exit {process.returncode}: {said}")
                else:
                    outcome = "unclean"
                shutil.rmtree(place)
                return outcome or "unclean", fault and f"{kind}: {fault}"

            tries(row, seed, share, 60, one)

    return attack


def after_stop(b: Bench, kind: str, place: Path) -> tuple[str, str]:
    if (place / "a").exists():  # the numbers were there: pictures alone are missing
        kept = {"run.nc", "sweep.nc", "compare.json", "verdict.json"} & {p.name for p in (place / "a").iterdir()}
        return "without pictures", "" if kept else "no numbers"
    return after_kill(b, kind, place)


def full_disk(row, seed: int, share: float) -> None:
    """A disk that fills up at a random size: one line, and the run goes on when there is room."""
    with bench() as b:
        b.reference("run in 2D", fresh=False)
        needed = sum(p.stat().st_size for p in (b.place / "known-run-in-2D").rglob("*"))
        mounted = small_disk(b.place, needed)

        def one(rng) -> tuple[str, str]:
            size, place = int(rng.uniform(0.01, 1.5) * needed), Path(tempfile.mkdtemp(dir=b.place))
            if mounted:
                subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", place], check=True)
                code, said = b.call(b.words("run in 2D", place / "a"), fresh=False)
            else:
                code, said = b.call(b.words("run in 2D", place / "a"), preexec_fn=lambda: limit(size // 3))
            outcome, fault = after_full(b, place, code, said, mounted)
            if mounted:
                subprocess.run(["umount", place], check=True)
            shutil.rmtree(place)
            return outcome, fault and f"{size} bytes: {fault}"

        tries(row, seed, share, 40, one)


def after_full(b: Bench, place: Path, code: int, said: str, mounted: bool) -> tuple[str, str]:
    out = place / "a"
    if clean_words(said):
        return "unclean", clean_words(said)
    if code == 0:
        return "enough room", b.right("run in 2D", out)
    if mounted:
        subprocess.run(["mount", "-o", "remount,size=1g", place], check=True)
    if out.exists():
        return "without pictures", "" if (out / "run.nc").is_file() and "missing in" in said else f"exit {code}: {said}"
    waiting = list(place.glob("a.partial*/checkpoint.h5"))
    if not waiting:
        return "no room for a checkpoint", "" if not list(place.iterdir()) else f"left: {list(place.rglob('*'))}"
    code, said = b.call(["run", "--resume", str(out)], fresh=False)
    return "resumed", f"exit {code}: {said}" if code else b.right("run in 2D", out)


def small_disk(place: Path, size: int) -> bool:
    """Whether a small file system can be mounted here."""
    where = place / "disk"
    where.mkdir()
    try:
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", where], capture_output=True)
    except OSError:
        return False
    if done.returncode == 0:
        subprocess.run(["umount", where], check=True)
    return done.returncode == 0


def limit(size: int) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def damaged(row, seed: int, share: float) -> None:
    """Random bytes changed, cut or swapped in the files of a waiting run: refused in one line, or the same answer."""
    with bench() as b:
        place = b.place / "waiting"
        place.mkdir()
        with b.start([*b.words("run in 2D", place / "a"), "schedule.repetitions=3000"]) as process:
            while not list(place.glob("a.partial/checkpoint.h5")):
                time.sleep(0.05)
            time.sleep(1.0)
            process.send_signal(signal.SIGINT)
            process.communicate()
        names = ("checkpoint.h5", "frames.bin", "case.toml")
        held = {name: (place / "a.partial" / name).read_bytes() for name in names}

        def one(rng) -> tuple[str, str]:
            name = names[rng.integers(3)]
            data = bytearray(held[name])
            way = ("five bytes", "one bit", "cut", "a block of zeros")[rng.integers(4)]
            at = int(rng.integers(len(data)))
            if way == "five bytes":
                for k in rng.integers(0, len(data), 5):
                    data[k] ^= int(rng.integers(1, 256))
            elif way == "one bit":
                data[at] ^= 1 << int(rng.integers(8))
            elif way == "cut":
                del data[at:]
            else:
                data[at : at + 512] = bytes(len(data[at : at + 512]))
            (place / "a.partial" / name).write_bytes(data)
            try:
                checkpoint.load_checkpoint(place / "a.partial")
            except BadInput as fault:
                return "refused", "two lines" if "\n" in str(fault) else ""
            finally:
                (place / "a.partial" / name).write_bytes(held[name])
            return "accepted", "" if bytes(data) == held[name] else f"{name}: {way} at {at}"

        tries(row, seed, share, 2000, one)


CLASSES = {f"kill -9 of a {kind}": killed(kind) for kind in KINDS} | {
    "Ctrl-C at a random moment": stopped(signal.SIGINT),
    "SIGTERM at a random moment": stopped(signal.SIGTERM),
    "full disk": full_disk,
    "damaged checkpoint, fields or case": damaged,
}
