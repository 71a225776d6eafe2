"""What goes wrong around a command: streams that take nothing, names that cannot be, signals, an
exhausted machine.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

from shell import NOISE, POINT, done, refused, run, split

from aacmm_pin._support.text_escaping import printable


def started(*words: str, **named: Any) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "aacmm_pin.cli", *split(*words)]
    return subprocess.Popen(
        command, **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | named
    )


def ended(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """Exit status and stderr, which is one line."""
    _, said = process.communicate(timeout=60)
    assert said.count(b"\n") == 1, said
    return process.returncode, said.decode()


def test_every_way_to_fail_is_one_line_and_its_status(monkeypatch):
    """Also the message of an interrupt, whenever it comes, is true: it says nothing of what was
    done before.
    """
    for error, status, said in (
        (OSError(28, "No space left on device"), 1, "No space left"),
        (PermissionError(13, "Permission denied", "a\x1bb"), 1, r"a\x1bb: Permission denied"),
        (MemoryError("Unable to allocate 7.45 GiB"), 1, "memory: Unable to allocate 7.45 GiB"),
        (MemoryError(), 1, "memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ):

        def fail(*_: object, error: BaseException = error, **__: object) -> None:
            raise error

        with monkeypatch.context() as patched:
            patched.setattr("aacmm_pin.cli.urdf.urdf_text", fail)
            found, out, err = run("urdf sino6")
        assert (found, out, err.count("\n"), said in err) == (status, "", 1, True), (error, err)


def test_what_libraries_warn_of_is_a_note(monkeypatch):
    def warn(*_: object, **__: object) -> str:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            for kind in (DeprecationWarning, FutureWarning, RuntimeWarning):
                warnings.warn(f"{kind.__name__}\x1b", kind, stacklevel=1)
        return ""

    monkeypatch.setattr("aacmm_pin.cli.urdf.urdf_text", warn)
    with warnings.catch_warnings():
        assert run("urdf sino6") == (0, "", "warning: RuntimeWarning\\x1b\n")


def test_streams_that_take_nothing():
    with open("/dev/full", "wb") as full:
        devices = [(started("urdf", "sino6", stdout=full), "No space left")]
    closed = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "aacmm_pin.cli", "causes"]
    devices += [(subprocess.Popen(closed, stderr=subprocess.PIPE), "not writable")]
    for process, words in devices:
        status, said = ended(process)
        assert (status, words in said) == (1, True), said


def test_a_pipe_whose_reader_has_enough_ends_the_command_quietly():
    """As ``head`` does."""
    read, write = os.pipe()
    os.close(read)
    process = started("causes", stdout=write)
    os.close(write)
    said = process.communicate(timeout=60)[1].decode()
    assert (process.returncode, "aacmm-pin:" in said) == (128 + signal.SIGPIPE, False), said


def test_names_that_cannot_be(tmp_path, monkeypatch):
    long = "x" * 300
    for words in (
        ("urdf", f"{long}.toml"),
        ("calibrate", "sino6", long),
        ("urdf", "sino6", "-o", long),
    ):
        assert "too long" in refused(words, said=[long])
    monkeypatch.chdir(tmp_path)
    strange = os.fsdecode(b"bad\xff\x1b.csv")
    done(f"simulate sino6 --records 40 -o {strange}")
    out, err = done(f"calibrate sino6 {strange} --no-cross-validation --json a.json -o a.toml")
    assert "\x1b" not in out + err
    refused(f"calibrate sino6 {strange}.none", said=[r"bad\udcff\x1b.csv.none"])
    assert r"bad\udcff\u001b.csv" in Path("a.json").read_text(encoding="utf-8")


def test_no_command_replaces_what_it_reads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done("simulate sino6 --records 40 -o data.csv --arm-out arm.toml")
    done("urdf sino6 -o arm.urdf")
    urdf = "--urdf arm.urdf --frame tip"
    done(
        "calibrate",
        urdf,
        f"--translation-half-width-mm 0.3 data.csv {NOISE} --no-cross-validation -o of_urdf.toml",
    )
    read = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    (tmp_path / "link.urdf").symlink_to("arm.urdf")
    for words, inputs in (
        ("calibrate arm.toml data.csv -o", ["arm.toml", "data.csv"]),
        ("correct arm.toml data.csv -o", ["arm.toml"]),
        ("simulate arm.toml --arm-out", ["arm.toml"]),
        ("plan distinguish arm.toml --existing data.csv --arm-out", ["data.csv"]),
        ("map arm.toml -o map.nc --json", ["arm.toml"]),
        (f"accuracy {urdf} {POINT} --json", ["arm.urdf"]),
        ("diagnose of_urdf.toml data.csv --arm-out", ["arm.urdf", "link.urdf"]),
        ("correct sino6 data.csv --nominal of_urdf.toml -o", ["arm.urdf"]),
        ("accept of_urdf.toml data.csv --json", ["arm.urdf"]),
    ):
        for name in inputs:
            refused(words, f"{name} --force", said=[name, "reads this file"])
    assert {path: path.read_bytes() for path in read} == read


def test_text_that_a_terminal_would_act_on():
    for text, shown in (
        ("α µ\u00a0mm\tb\n", "α µ\u00a0mm\tb\n"),
        ("\x1b[2J\r\x07\x9b", r"\x1b[2J\r\x07\x9b"),
    ):
        assert printable(text) == shown
    for text in ("a\u202eb", "\u2028", os.fsdecode(b"\xff"), "\x00"):
        assert printable(text).isprintable(), text
    refused("urdf", "none\x1b[31m", said=[r"none\x1b[31m"])
