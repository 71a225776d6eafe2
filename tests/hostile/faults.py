"""Real commands that are stopped, or cannot write: afterwards all their files are as before, or all
of them are new.

Of a process that is killed each file is whole.

A fault is told by an AssertionError; what happened otherwise is a word for the table.
"""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import xarray as xr

from aacmm_pin._support.output_files import HIDDEN

OLD = "what was there before"
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL)
PATIENCE = 120.0
"""So long a command may take to end after a signal, or the processes that it started after it [s].
"""


@dataclass(frozen=True)
class Command:
    """Words of a command that takes about a second, and the files that it writes."""

    text: str
    outputs: tuple[str, ...]

    def words(self) -> list[str]:
        """As the shell takes them."""
        return self.text.split()


SIMULATE = Command(
    "simulate sino6 --records 40 --seed 2 -o data.csv --arm-out truth.toml",
    ("data.csv", "truth.toml"),
)
GIVEN = Command("simulate sino6 --scheme free --records 40 --seed 2 -o given.csv", ("given.csv",))
CALIBRATE = Command(
    "calibrate sino6 given.csv --no-cross-validation -o arm.toml --json fit.json "
    "--residuals left.csv",
    ("arm.toml", "fit.json", "left.csv"),
)
MAP = Command(
    "map sino6 --cells 40 40 --sectors 4 --workers 2 -o map.nc --json map.json --plot map.png",
    ("map.nc", "map.json", "map.png"),
)
COMMANDS = (SIMULATE, CALIBRATE, MAP)


@dataclass
class Place:
    """A folder with old outputs in it; ``reference`` is what a command writes that nobody
    disturbs.
    """

    command: Command
    folder: Path
    reference: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    @staticmethod
    def of(command: Command, folder: Path) -> Place:
        """In the new ``folder``, after a run that nobody disturbs."""
        folder.mkdir()
        place = Place(command, folder)
        if "given.csv" in command.text:
            made = start(GIVEN.words(), folder)
            assert ended(made) == 0
        began = time.monotonic()
        run = start(command.words(), folder)
        assert ended(run) == 0, told(run)
        place.seconds = time.monotonic() - began
        place.reference = place.outputs()
        place.fill()
        return place

    def fill(self) -> None:
        """Put old files where the outputs go."""
        for name in self.command.outputs:
            (self.folder / name).write_text(OLD)

    def outputs(self) -> dict[str, Any]:
        """What stands in the files, but for the time that the work took."""
        return {
            name: content(self.folder / name)
            for name in self.command.outputs
            if (self.folder / name).exists()
        }

    def judged(self) -> str:
        """``old`` or ``new``, and nothing hidden is left."""
        left = [path.name for path in self.folder.glob(f"{HIDDEN}*")]
        assert not left, f"{self.command.text}: left {left}"
        found = self.outputs()
        if found == dict.fromkeys(self.command.outputs, OLD.encode()):
            return "old"
        same = {name: found.get(name) == new for name, new in self.reference.items()}
        assert all(same.values()), f"{self.command.text}: a mixture of old and new: {same}"
        return "new"

    def each_whole(self) -> str:
        """``whole``: each file is the old one or the new one; what a killed process hid is removed
        here.
        """
        for folder in self.folder.glob(f"{HIDDEN}*"):
            shutil.rmtree(folder)
        for name, found in self.outputs().items():
            assert found in (OLD.encode(), self.reference[name]), (
                f"{self.command.text}: {name} is half-written"
            )
        return "whole"


def content(path: Path) -> Any:
    """Bytes; of formats that state how long the work took, the rest."""
    read = path.read_bytes()
    if read != OLD.encode() and path.suffix == ".json":
        return {key: value for key, value in json.loads(read).items() if key != "seconds"}
    if read != OLD.encode() and path.suffix == ".nc":
        with xr.open_dataset(path) as data:
            return {name: values.to_numpy().tobytes() for name, values in data.variables.items()}
    return read


Run = subprocess.Popen[bytes]


def start(
    words: list[str], folder: Path, limit: Callable[[], None] | None = None, **options: Any
) -> Run:
    """A command as the shell starts it, in a session of its own."""
    command = [sys.executable, "-m", "aacmm_pin.cli", *words]
    streams = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.PIPE,
    } | options
    return subprocess.Popen(
        command, cwd=folder, start_new_session=True, preexec_fn=limit, **streams
    )


def ended(run: Run) -> int:
    """Exit status; nothing that it started lives on, and it told no traceback.

    ``run.said`` is then its text on stderr.
    """
    try:
        _, said = run.communicate(timeout=PATIENCE)
        late = time.monotonic() + PATIENCE
        while alive := in_session(run.pid):
            assert time.monotonic() < late, f"{run.args}: processes {alive} live on"
            time.sleep(0.05)
    except subprocess.TimeoutExpired:
        raise AssertionError(f"{run.args}: no end within {PATIENCE:g} s") from None
    finally:
        for pid in in_session(run.pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        run.wait()
    run.said = (said or b"").decode(errors="replace")
    assert "Traceback" not in told(run), f"{run.args}: {told(run)[-2000:]}"
    return run.returncode


def told(run: Run) -> str:
    """What it said on stderr."""
    return str(getattr(run, "said", ""))


def in_session(leader: int) -> list[int]:
    """Processes of the session that a process leads, those that ended excepted."""
    return [
        pid
        for pid, (state, _, session) in processes().items()
        if session == leader and state not in "ZX"
    ]


def processes() -> dict[int, tuple[str, int, int]]:
    """State, parent and session of every process."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent, _, session = path.read_text().rpartition(")")[2].split()[:4]
            found[int(path.parent.name)] = (state, int(parent), int(session))
    return found


def works(pid: int) -> bool:
    """Whether a process is one of a pool, and not Python's own that counts what they share."""
    with suppress(OSError):
        return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    return False


# --- faults


def stopped(place: Place, number: int, after: float, everyone: bool) -> str:
    """A signal after some time, to the command alone or to all that it started, as a terminal sends
    it.
    """
    place.fill()
    run = start([*place.command.words(), "--force"], place.folder)
    time.sleep(after)
    if run.poll() is None:
        (os.killpg if everyone else os.kill)(run.pid, number)
    status = ended(run)
    if number == signal.SIGKILL:
        return place.each_whole()
    outcome = place.judged()
    assert status != 0 or outcome == "new", f"{place.command.text}: status 0, but nothing new"
    return outcome


def refused(place: Place, limit: Callable[[], None] | None = None) -> str:
    """A command that cannot write says so in one line, and all is as before."""
    run = start([*place.command.words(), "--force"], place.folder, limit)
    status = ended(run)
    assert (status, place.judged()) == (1, "old"), (place.command.text, status, told(run))
    assert told(run).splitlines()[-1].startswith("aacmm-pin: "), told(run)
    assert HIDDEN not in told(run), told(run)
    return "refused"


def small_files() -> None:
    """No file may grow beyond a thousand bytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))


@contextmanager
def disk(folder: Path, size: str) -> Iterator[Callable[[str], None]]:
    """A small file system at ``folder``, where that is allowed; gives what changes its options.

    Raises:
        PermissionError: it is not allowed.
    """
    folder.mkdir(exist_ok=True)

    def mount(options: str) -> None:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder],
            capture_output=True,
            check=False,
        )
        if done.returncode:
            raise PermissionError(done.stderr.decode())

    mount(f"size={size}")
    try:
        yield lambda options: mount(f"remount,{options}")
    finally:
        subprocess.run(["umount", folder], check=True)


def full_disk(place: Place) -> str:
    """Room for the old files, not for the new."""
    with disk(place.folder, "16k"):
        if "given.csv" in place.command.text:
            (place.folder / "given.csv").symlink_to(place.folder.with_name("given.csv"))
        place.fill()
        return refused(place)


def read_only(place: Place) -> str:
    """Nothing may be written."""
    with disk(place.folder, "64k") as change:
        place.fill()
        change("ro")
        return refused(place)


def full_devices(place: Place) -> str:
    """Outputs, and what is said, to a device that is full."""
    first, *others = place.command.outputs
    words = [{first: "/dev/full"}.get(word, word) for word in place.command.words()]
    with open("/dev/full", "wb") as full:
        for run in (
            start([*words, "--force"], place.folder),
            start(["urdf", "sino6"], place.folder, stdout=full),
        ):
            assert ended(run) == 1, told(run)
            assert "No space left" in told(run), told(run)
    assert {name: place.outputs()[name] for name in others} == dict.fromkeys(others, OLD.encode())
    return "refused"


def worker_killed(place: Place, after: float) -> str:
    """One of the processes that a command has started is killed."""
    place.fill()
    run = start([*place.command.words(), "--force"], place.folder)
    late = time.monotonic() + PATIENCE
    workers: list[int] = []
    while not workers and run.poll() is None and time.monotonic() < late:
        workers = [
            pid for pid, (_, parent, _) in processes().items() if parent == run.pid and works(pid)
        ]
        time.sleep(0.01)
    time.sleep(after)
    assert workers, f"{place.command.text}: has no workers"
    with suppress(ProcessLookupError):
        os.kill(random.choice(workers), signal.SIGKILL)
    status = ended(run)
    outcome = place.judged()
    assert status == (0 if outcome == "new" else 1), (status, outcome, told(run))
    return outcome
