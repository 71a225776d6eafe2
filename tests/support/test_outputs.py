"""Outputs are whole or absent: failures, interruptions, existing files, and places that cannot be written to."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from aacmm_pin._support.output_files import check_output, check_output_folder, whole_file, whole_folder
from aacmm_pin.errors import OutputError


def listing(folder: Path) -> dict[str, str]:
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else "" for p in sorted(folder.rglob("*"))}


def stop_half_way(output: AbstractContextManager[Path], failure: type[BaseException]) -> None:
    def work() -> None:
        with output as temporary:
            (temporary / "index.html" if temporary.is_dir() else temporary).write_text("half of")
            raise failure("stop")

    with pytest.raises(failure):
        work()


def refused(output: AbstractContextManager[Path], words: str) -> None:
    with pytest.raises(OutputError, match=words), output:
        pytest.fail("work began")


def test_a_file_and_a_folder_appear_when_all_went_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert check_output("out.csv", force=False) == Path("out.csv")
    assert check_output_folder(str(tmp_path / "report"), force=False) == tmp_path / "report"
    assert listing(tmp_path) == {}
    with whole_file("out.csv") as temporary:
        temporary.write_text("all of it")
        assert temporary.name == "out.csv"  # the suffix decides the format for some writers
        assert not Path("out.csv").exists()
    with whole_folder("report") as folder:
        (folder / "index.html").write_text("page")
        (folder / "data").mkdir()
        (folder / "data" / "a.csv").write_text("1")
        assert not Path("report").exists()
    report = {"report": "", "report/data": "", "report/data/a.csv": "1", "report/index.html": "page"}
    assert listing(tmp_path) == {"out.csv": "all of it"} | report
    Path("plain").write_text("")  # others may read them: the private mode of the temporary folder does not stick
    Path("folder").mkdir()
    assert Path("out.csv").stat().st_mode == Path("plain").stat().st_mode
    assert Path("report").stat().st_mode == Path("folder").stat().st_mode


def test_a_failure_inside_leaves_all_as_it_was(tmp_path: Path) -> None:
    for failure in (RuntimeError, ValueError, KeyboardInterrupt, SystemExit, GeneratorExit):
        stop_half_way(whole_file(tmp_path / "out.csv"), failure)
        stop_half_way(whole_folder(tmp_path / "report"), failure)
    assert listing(tmp_path) == {}
    (tmp_path / "out.csv").write_text("old")
    stop_half_way(whole_file(tmp_path / "out.csv", force=True), KeyboardInterrupt)
    assert listing(tmp_path) == {"out.csv": "old"}
    with pytest.raises(OutputError, match=r"none\.csv"), whole_file(tmp_path / "none.csv"):
        pass  # nothing was written
    with pytest.raises(OutputError, match=r"full\.csv.*No space left"), whole_file(tmp_path / "full.csv"):
        raise OSError(28, "No space left on device")
    assert listing(tmp_path) == {"out.csv": "old"}


def test_what_is_there_is_replaced_only_by_force(tmp_path: Path) -> None:
    path, report = tmp_path / "out.csv", tmp_path / "report"
    path.write_text("old")
    refused(whole_file(path), r"exists already.*--force")
    with whole_file(path, force=True) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new"
    report.mkdir()
    with whole_folder(report) as folder:  # an empty folder may be used
        (folder / "index.html").write_text("old")
    (report / "mine.txt").write_text("keep")
    refused(whole_folder(report), r"not empty.*--force")
    stop_half_way(whole_folder(report, force=True), RuntimeError)
    assert listing(report) == {"index.html": "old", "mine.txt": "keep"}
    with whole_folder(report, force=True) as folder:
        (folder / "index.html").write_text("new")
    assert listing(report) == {"index.html": "new", "mine.txt": "keep"}  # replaces files of the same names, no others
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")  # a link that dangles is not there
    with whole_file(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").read_text() == "new"


def test_folders_and_files_within_a_folder_are_replaced_whole(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "old.csv").write_text("old")
    (tmp_path / "was file").write_text("old")
    (tmp_path / "was folder").mkdir()
    (tmp_path / "was folder" / "a.csv").write_text("old")
    with whole_folder(tmp_path, force=True) as folder:
        for name in ("data", "was file"):
            (folder / name).mkdir()
            (folder / name / "new.csv").write_text("new")
        (folder / "was folder").write_text("new")
    new = {"data": "", "data/new.csv": "new", "was file": "", "was file/new.csv": "new", "was folder": "new"}
    assert listing(tmp_path) == new


def test_places_that_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("old")
    (tmp_path / "folder").mkdir()
    for force in (False, True):
        refused(whole_file(tmp_path / "folder", force=force), "is a folder")
        refused(whole_folder(tmp_path / "file", force=force), "is a file")
    for open_output in (whole_file, whole_folder):
        refused(open_output(tmp_path / "none" / "out"), "does not exist")
        refused(open_output(tmp_path / "file" / "out"), "out")
        if Path("/proc/self").is_dir():
            refused(open_output(Path("/proc/aacmm-out")), "/proc")
    assert listing(tmp_path) == {"file": "old", "folder": ""}
