"""Outputs are whole or absent, together, and replace nothing but regular files, and these only when
that was asked for.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from aacmm_pin._support.output_files import OutputFiles, whole_file
from aacmm_pin.errors import OutputError

pytestmark = pytest.mark.fast


def listing(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): p.read_text() if p.is_file() else ""
        for p in sorted(folder.rglob("*"))
    }


def write(*paths: str | Path, text: str = "new", force: bool = False) -> None:
    with OutputFiles(force) as files:
        for path in paths:
            files.file(path).write_text(text)


def test_files_appear_together_when_all_went_well(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plain").write_text("")
    with OutputFiles() as files:
        files.check("out.csv", tmp_path / "b.csv")
        temporary = files.file("out.csv")
        write(temporary, text="all of it")  # as a command does what Python saves
        assert temporary.name == "out.csv"  # the suffix decides the format for some writers
        assert not Path("out.csv").exists()
    expected = {
        "plain": "",
        "out.csv": "all of it",
    }
    assert listing(tmp_path) == expected
    # others may read them: the private mode of the hidden folder does not stick
    assert Path("out.csv").stat().st_mode == Path("plain").stat().st_mode


def test_a_failure_inside_leaves_all_as_it_was(tmp_path):
    (tmp_path / "old.csv").write_text("old")

    def work(failure: BaseException) -> None:
        with OutputFiles(force=True) as files:
            files.file(tmp_path / "old.csv").write_text("half of")
            files.file(tmp_path / "new.csv").write_text("half of")
            raise failure

    for failure in (
        RuntimeError(),
        KeyboardInterrupt(),
        SystemExit(),
        OSError(28, "No space left on device"),
    ):
        with pytest.raises(OutputError if isinstance(failure, OSError) else type(failure)):
            work(failure)
        assert listing(tmp_path) == {"old.csv": "old"}
    with pytest.raises(OutputError, match=r"none\.csv"), whole_file(tmp_path / "none.csv"):
        pass  # nothing was written


def test_what_is_there_is_replaced_only_by_force(tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("old")
    path.chmod(0o600)
    with pytest.raises(OutputError, match=r"out\.csv.*exists already.*--force"):
        write(tmp_path / "other", path)
    assert listing(tmp_path) == {"out.csv": "old"}
    write(path, force=True)
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o600
    (tmp_path / "report").mkdir()
    with pytest.raises(OutputError, match="two results"):
        write(path, tmp_path / "report" / ".." / "out.csv", force=True)
    with pytest.raises(OutputError, match="two results"):
        OutputFiles(force=True).check(path, path)


def test_links_are_followed(tmp_path):
    (tmp_path / "dangling").symlink_to("target")
    write(tmp_path / "dangling")
    assert (tmp_path / "dangling").is_symlink()
    assert (tmp_path / "target").read_text() == "new"
    with pytest.raises(OutputError, match="exists already"):
        write(tmp_path / "dangling")
    write(tmp_path / "dangling", text="newer", force=True)
    assert listing(tmp_path) == {"dangling": "newer", "target": "newer"}
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match="loop"):
        write(tmp_path / "loop", force=True)


def test_pipes_and_devices_are_written_to_and_stay(tmp_path, capsys):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    write(pipe, tmp_path / "beside", "-", "/dev/null", force=True)
    reader.join()
    assert read == ["new"]
    assert pipe.is_fifo()
    assert Path("/dev/null").is_char_device()
    assert capsys.readouterr().out == "new"
    assert (tmp_path / "beside").read_text() == "new"
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    with pytest.raises(OutputError, match=r"/dev/full.*No space left"):
        write(tmp_path / "beside", tmp_path / "more", "/dev/full", text="newer", force=True)
    assert listing(tmp_path) == {"beside": "new", "pipe": ""}  # the rest was put back


def test_if_one_cannot_be_put_in_place_none_is(tmp_path, monkeypatch):
    (tmp_path / "a").write_text("old")
    (tmp_path / "c").write_text("old")
    replace = os.replace

    def refuse(source: Path, target: Path) -> None:
        if target.name == "c" and source.name == "c":
            raise PermissionError(1, "Operation not permitted")
        replace(source, target)

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(OutputError, match=r"/c: .*cannot be written: Operation not permitted"):
        write(*(tmp_path / name for name in "abc"), force=True)
    assert listing(tmp_path) == {"a": "old", "c": "old"}


def test_a_file_that_appears_meanwhile_stays(tmp_path):
    def work() -> None:
        with OutputFiles() as files:
            for name in ("a", "out"):
                files.file(tmp_path / name).write_text("ours")
            (tmp_path / "out").write_text("theirs")

    with pytest.raises(OutputError, match="exists already"):
        work()
    assert listing(tmp_path) == {"out": "theirs"}


def test_a_file_that_was_read_to_be_extended_is_replaced(tmp_path):
    (tmp_path / "checks").write_text("old")
    with OutputFiles(inputs=[tmp_path / "checks"]) as files:
        files.file(tmp_path / "checks", update=True).write_text("longer")
    assert listing(tmp_path) == {"checks": "longer"}


def test_what_is_read_is_never_replaced(tmp_path):
    data = tmp_path / "data"
    data.write_text("old")
    (tmp_path / "link").symlink_to("data")
    (tmp_path / "hard").hardlink_to(data)
    for name in ("data", "link", "hard", "../" + tmp_path.name + "/data"):
        with pytest.raises(OutputError, match="reads this file"):
            OutputFiles(True, [data, "none"]).check(tmp_path / "new", tmp_path / name)
    for name in ("link", "hard"):
        with (
            pytest.raises(OutputError, match="reads this file"),
            OutputFiles(True, [tmp_path / name]) as files,
        ):
            files.file(data)
    assert data.read_text() == "old"


def test_places_that_cannot_be_written_to(tmp_path):
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    places = {
        "none/out": "does not exist",
        "file/out": "out",
        "x" * 300: "too long",
        "/proc/aacmm-out": "/proc",
    }
    for force in (False, True):
        for name, words in ({"folder": "is a folder"} | places).items():
            with pytest.raises(OutputError, match=words):
                write(tmp_path / name, force=force)
    assert listing(tmp_path) == {"file": "old", "folder": ""}
