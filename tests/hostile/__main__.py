"""``python -m tests.hostile --cases 10000 --kills 200`` tries files with mistakes and faults, and
prints what happened.

``--page notebooks/site/robustness.md`` writes the counts into that page. Files that did harm are
kept in ``--keep``.
"""

from __future__ import annotations

import argparse
import json
import random
import signal
import subprocess
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from hypothesis import HealthCheck, given, settings
from hypothesis import seed as seeded

from aacmm_pin.errors import AacmmError
from tests.hostile import faults
from tests.hostile.formats import FORMATS, Format, mutated
from tests.hostile.test_formats import LONGEST, LONGEST_LINE
from tests.measured import commit, digest

BATCH = 500
"""Files that one process tries; one that it cannot survive ends the batch."""
GOOD = ("result", "refused", "old", "new", "whole")
"""How outcomes begin that are as promised."""
STARTED = 0.2
"""By then Python itself has started, and listens to us [s]."""
ROOMS = ("calibration", "cli", "measurements")
"""Whose code, with all that these rooms import, is tried."""
BEGIN, END = "<!-- counts -->\n", "<!-- end of counts -->"


def tried(kind: Format, cases: int, seed: int, keep: Path) -> Counter[str]:
    """Outcomes of that many files of a format; one that did harm is kept, and the last one where
    the process dies.
    """
    counts: Counter[str] = Counter()
    path = keep / f"now-{kind.name}"

    def late(number: int, frame: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)

    @seeded(seed)
    @settings(
        max_examples=cases, deadline=None, database=None, suppress_health_check=[*HealthCheck]
    )
    @given(mutated(kind.valid()))
    def used(content: bytes) -> None:
        path.write_bytes(content)
        began = time.process_time()
        signal.alarm(int(20 * LONGEST))
        try:
            kind.use(path)
            outcome = "result"
        except AacmmError as error:
            longest = max(map(len, str(error).splitlines()), default=0)
            outcome = (
                "refused"
                if longest < LONGEST_LINE
                else f"a message of more than {LONGEST_LINE} characters"
            )
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            outcome = f"{type(error).__name__} in {Path(at.filename).name}, {at.name}"
        signal.alarm(0)
        if time.process_time() - began > LONGEST:
            outcome = f"longer than {LONGEST:g} s"
        if not outcome.startswith(GOOD) and not counts[outcome]:
            (keep / f"{len(list(keep.iterdir()))}-{kind.name}").write_bytes(content)
        counts[outcome] += 1

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        used()
    path.unlink()
    return counts


def of_format(kind: Format, cases: int, seed: int, keep: Path) -> Counter[str]:
    """The same in processes of their own, which a file may end."""
    counts: Counter[str] = Counter()
    for batch, first in enumerate(range(0, cases, BATCH)):
        size = min(BATCH, cases - first)
        words = [
            "--only",
            kind.name,
            "--cases",
            str(size),
            "--seed",
            str(seed + batch),
            "--keep",
            str(keep),
        ]
        run = subprocess.run(
            [sys.executable, "-m", "tests.hostile", *words], stdout=subprocess.PIPE, check=False
        )
        if run.returncode:
            counts[f"the process ended with {run.returncode}"] += 1
            (keep / f"now-{kind.name}").rename(keep / f"ended-{seed + batch}-{kind.name}")
        else:
            counts.update(json.loads(run.stdout))
    return counts


def of_faults(kills: int, seed: int, folder: Path) -> Iterator[tuple[str, Counter[str]]]:
    """Every fault of every command, and as many signals at random moments."""
    rng = random.Random(seed)
    places = [
        faults.Place.of(command, folder / command.text.split()[0]) for command in faults.COMMANDS
    ]
    rounds = range(max(1, kills // 20))
    yield (
        "limit of 1 kB for a file",
        counted(lambda place: faults.refused(place, faults.small_files), places, rounds),
    )
    yield "full file system", counted(faults.full_disk, places, rounds)
    yield "read-only file system", counted(faults.read_only, places, rounds)
    yield "full device", counted(faults.full_devices, places, rounds)
    pools = [place for place in places if "--workers" in place.command.text]
    yield (
        "killed worker",
        counted(lambda place: faults.worker_killed(place, rng.uniform(0, 2)), pools, rounds),
    )
    for number in faults.SIGNALS:

        def stop(place: faults.Place, number: int = number) -> str:
            return faults.stopped(
                place, number, rng.uniform(STARTED, 1.1 * place.seconds), rng.random() < 0.5
            )

        cycles = range(max(1, kills // (len(faults.SIGNALS) * len(places))))
        yield f"{number.name} at a random moment", counted(stop, places, cycles)


def counted(
    fault: Callable[[faults.Place], str], places: list[faults.Place], rounds: range
) -> Counter[str]:
    """Outcomes of a fault in each place, so many times."""
    counts: Counter[str] = Counter()
    for _ in rounds:
        for place in places:
            try:
                counts[fault(place)] += 1
            except PermissionError:
                counts["refused: the tests may not mount"] += 1
            except AssertionError as error:
                counts[f"FAULT of {place.command.text.split()[0]}"] += 1
                print(error, file=sys.stderr)
    return counts


def table(rows: list[tuple[str, Counter[str]]]) -> str:
    """Counts as Markdown; what is not as promised stands out."""
    lines = [
        "| Mistake or fault | Cases | Expected outcomes | Other outcomes |",
        "| --- | --- | --- | --- |",
    ]
    for what, counts in rows:
        good = {outcome: count for outcome, count in counts.items() if outcome.startswith(GOOD)}
        bad = {outcome: count for outcome, count in counts.items() if outcome not in good}
        of_each = [
            ", ".join(f"{count} {outcome}" for outcome, count in sorted(some.items())) or "0"
            for some in (good, bad)
        ]
        lines.append(f"| {what} | {counts.total()} | {' | '.join(of_each)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Status 1 where something was not as promised."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000, help="files of each format")
    parser.add_argument("--kills", type=int, default=200, help="signals")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--keep", type=Path, default=Path("out/hostile"), help="folder for the files that did harm"
    )
    parser.add_argument("--page", type=Path, help="page into which the counts are written")
    parser.add_argument(
        "--only",
        choices=[kind.name for kind in FORMATS],
        help="one format, in this process, as JSON",
    )
    given_ = parser.parse_args()
    # What a shell has it ignore, as in the background or by nohup, the commands that it starts
    # would ignore too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    given_.keep.mkdir(parents=True, exist_ok=True)
    keep = given_.keep.resolve()
    if given_.only:
        kind = next(kind for kind in FORMATS if kind.name == given_.only)
        print(json.dumps(tried(kind, given_.cases, given_.seed, keep)))
        return 0
    rows = [
        (f"mistakes in {kind.name}", of_format(kind, given_.cases, given_.seed, keep))
        for kind in FORMATS
    ]
    print(table(rows), file=sys.stderr)  # what follows may take long
    with TemporaryDirectory() as folder:
        rows += of_faults(given_.kills, given_.seed, Path(folder))
    command = (
        f"python -m tests.hostile --cases {given_.cases} --kills {given_.kills} --seed "
        f"{given_.seed}"
    )
    written = (
        f"`{command}`, commit `{commit()}`, {datetime.now(UTC):%Y-%m-%d}.\n\n"
        f"<!-- generated: code-age {digest(*ROOMS)} {' '.join(ROOMS)} -->\n\n{table(rows)}"
    )
    print(written)
    if given_.page:
        before, _, rest = given_.page.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        given_.page.write_text(f"{before}{BEGIN}{written}{END}{after}", encoding="utf-8")
    return int(any(not outcome.startswith(GOOD) for _, counts in rows for outcome in counts))


if __name__ == "__main__":
    sys.exit(main())
