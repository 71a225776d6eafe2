"""Outputs are whole or absent: failures, interruptions, existing files, and places that cannot be written to."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from aacmm_pin._support.output_files import check_output, check_output_folder, whole_file, whole_folder
from aacmm_pin.errors import OutputError

FAILURES = [RuntimeError, ValueError, KeyboardInterrupt, SystemExit, GeneratorExit]


def listing(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else "" for p in sorted(folder.rglob("*"))}


def stop_half_way(output: AbstractContextManager[Path], failure: type[BaseException]) -> None:
    with output as temporary:
        (temporary / "index.html" if temporary.is_dir() else temporary).write_text("half of")
        raise failure("stop")


# --- files


def test_file_appears_when_all_went_well(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    with whole_file(path) as temporary:
        temporary.write_text("all of it")
        assert temporary.name == "out.csv"  # the suffix decides the format for some writers
        assert not path.exists()
    assert listing(tmp_path) == {"out.csv": "all of it"}


@pytest.mark.parametrize("failure", FAILURES)
def test_failure_inside_leaves_no_file(tmp_path: Path, failure: type[BaseException]) -> None:
    with pytest.raises(failure):
        stop_half_way(whole_file(tmp_path / "out.csv"), failure)
    assert listing(tmp_path) == {}


@pytest.mark.parametrize("failure", FAILURES)
def test_failure_inside_keeps_the_old_file(tmp_path: Path, failure: type[BaseException]) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(failure):
        stop_half_way(whole_file(path, force=True), failure)
    assert listing(tmp_path) == {"out.csv": "old"}


def test_existing_file_is_replaced_only_by_force(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(OutputError, match=r"exists already.*--force"), whole_file(path):
        pytest.fail("work began")
    assert listing(tmp_path) == {"out.csv": "old"}
    with whole_file(path, force=True) as temporary:
        temporary.write_text("new")
    assert listing(tmp_path) == {"out.csv": "new"}


def test_a_folder_is_no_file_even_by_force(tmp_path: Path) -> None:
    for force in (False, True):
        with pytest.raises(OutputError, match="is a folder"), whole_file(tmp_path, force=force):
            pytest.fail("work began")


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"), whole_file(tmp_path / "none" / "out.csv"):
        pytest.fail("work began")
    assert listing(tmp_path) == {}


def test_a_file_in_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    for open_output in (whole_file, whole_folder):
        with pytest.raises(OutputError), open_output(tmp_path / "file" / "out"):
            pytest.fail("work began")
    assert listing(tmp_path) == {"file": "not a folder"}


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc")
def test_a_folder_that_refuses_to_write() -> None:
    for open_output in (whole_file, whole_folder):
        with pytest.raises(OutputError, match="/proc"), open_output(Path("/proc/aacmm-out")):
            pytest.fail("work began")


def test_nothing_written_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"out\.csv"), whole_file(tmp_path / "out.csv"):
        pass
    assert listing(tmp_path) == {}


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"out\.csv.*No space left"), whole_file(tmp_path / "out.csv"):
        raise OSError(28, "No space left on device")
    assert listing(tmp_path) == {}


def test_a_link_that_dangles_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with whole_file(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").read_text() == "new"


def test_relative_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with whole_file("out.csv") as temporary:
        temporary.write_text("a")
    with whole_folder("report") as folder:
        (folder / "index.html").write_text("b")
    assert listing(tmp_path) == {"out.csv": "a", "report": "", "report/index.html": "b"}


def test_looking_ahead_writes_nothing(tmp_path: Path) -> None:
    assert check_output(str(tmp_path / "out.csv"), force=False) == tmp_path / "out.csv"
    assert check_output_folder(str(tmp_path / "report"), force=False) == tmp_path / "report"
    assert listing(tmp_path) == {}


def test_a_written_file_may_be_read_by_others(tmp_path: Path) -> None:
    """Like any other new file: the private mode of the temporary folder does not stick to it."""
    (tmp_path / "plain").write_text("")
    with whole_file(tmp_path / "out.csv") as temporary:
        temporary.write_text("x")
    assert (tmp_path / "out.csv").stat().st_mode == (tmp_path / "plain").stat().st_mode


# --- folders


def test_folder_appears_when_all_went_well(tmp_path: Path) -> None:
    path = tmp_path / "report"
    with whole_folder(path) as folder:
        (folder / "index.html").write_text("page")
        (folder / "data").mkdir()
        (folder / "data" / "a.csv").write_text("1")
        assert not path.exists()
    expected = {"report": "", "report/data": "", "report/data/a.csv": "1", "report/index.html": "page"}
    assert listing(tmp_path) == expected
    (tmp_path / "plain").mkdir()
    assert path.stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("failure", FAILURES)
def test_failure_inside_leaves_no_folder(tmp_path: Path, failure: type[BaseException]) -> None:
    with pytest.raises(failure):
        stop_half_way(whole_folder(tmp_path / "report"), failure)
    assert listing(tmp_path) == {}


def test_full_folder_is_touched_only_by_force(tmp_path: Path) -> None:
    path = tmp_path / "report"
    path.mkdir()
    (path / "mine.txt").write_text("keep")
    (path / "index.html").write_text("old")
    with pytest.raises(OutputError, match=r"not empty.*--force"), whole_folder(path):
        pytest.fail("work began")
    with pytest.raises(RuntimeError):
        stop_half_way(whole_folder(path, force=True), RuntimeError)
    assert listing(path) == {"index.html": "old", "mine.txt": "keep"}
    with whole_folder(path, force=True) as folder:
        (folder / "index.html").write_text("new")
    assert listing(path) == {"index.html": "new", "mine.txt": "keep"}  # replaces files of the same names, no others


def test_folder_within_a_folder_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "report"
    (path / "data").mkdir(parents=True)
    (path / "data" / "old.csv").write_text("old")
    with whole_folder(path, force=True) as folder:
        (folder / "data").mkdir()
        (folder / "data" / "new.csv").write_text("new")
    assert listing(path) == {"data": "", "data/new.csv": "new"}


@pytest.mark.parametrize("was_a_file", [True, False])
def test_a_name_that_changes_from_file_to_folder(tmp_path: Path, was_a_file: bool) -> None:
    path = tmp_path / "report"
    path.mkdir()
    old, other = path / "data", path / "later"
    if was_a_file:
        old.write_text("old")
    else:
        old.mkdir()
        (old / "a.csv").write_text("old")
    other.write_text("old")
    with whole_folder(path, force=True) as folder:
        (folder / "later").write_text("new")
        if was_a_file:
            (folder / "data").mkdir()
            (folder / "data" / "a.csv").write_text("new")
        else:
            (folder / "data").write_text("new")
    expected = {"data": "", "data/a.csv": "new"} if was_a_file else {"data": "new"}
    assert listing(path) == expected | {"later": "new"}


def test_empty_folder_may_be_used(tmp_path: Path) -> None:
    path = tmp_path / "report"
    path.mkdir()
    with whole_folder(path) as folder:
        (folder / "index.html").write_text("page")
    assert listing(path) == {"index.html": "page"}


def test_a_file_is_no_folder_even_by_force(tmp_path: Path) -> None:
    (tmp_path / "report").write_text("old")
    for force in (False, True):
        with pytest.raises(OutputError, match="is a file"), whole_folder(tmp_path / "report", force=force):
            pytest.fail("work began")
    assert listing(tmp_path) == {"report": "old"}


def test_missing_parent_of_a_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="does not exist"), whole_folder(tmp_path / "none" / "report"):
        pytest.fail("work began")
