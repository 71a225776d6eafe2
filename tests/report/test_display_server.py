"""The server of a live scene: on loopback only, for its own pages only, gone when it is closed; and the command."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
from meshcat.geometry import Box
from typer.testing import CliRunner

from aacmm_pin import Arm
from aacmm_pin.cli import app
from aacmm_pin.errors import AacmmError
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Scene, serving
from aacmm_pin.report.scenes import server as serving_from

POINT = ["--point", "33.6323", "-671.8702", "182.9355"]


def port_of(url: str) -> int:
    return int(re.fullmatch(r"http://127\.0\.0\.1:(\d+)/static/", url)[1])  # type: ignore[index]


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens, from the kernel's own tables: hexadecimal, IPv4 and IPv6."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        if match := re.fullmatch(r"socket:\[(\d+)\]", os.readlink(entry)):
            inodes.add(match[1])
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in inodes:
                found.add(words[1])
    return found


def get(url: str, path: str = "/static/", **headers: str) -> tuple[int, str]:
    """Status and text of an answer."""
    host, port = "127.0.0.1", port_of(url)
    with socket.create_connection((host, port), timeout=20) as connection:
        every = {"Host": f"{host}:{port}", "Connection": "close"} | headers
        lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in every.items())
        connection.sendall(f"GET {path} HTTP/1.1\r\n{lines}\r\n".encode())
        answer = connection.recv(1 << 16)
        connection.shutdown(socket.SHUT_WR)  # a WebSocket would stay open
        while part := connection.recv(1 << 16):
            answer += part
    return int(answer.split()[1]), answer.decode(errors="replace")


@pytest.fixture
def scene() -> Scene:
    made = Scene("a box")
    made["box"].set_object(Box([1.0, 1.0, 1.0]))
    return made


@pytest.mark.skipif(not Path("/proc/net/tcp").is_file(), reason="needs Linux's /proc/net")
def test_it_listens_on_loopback_alone(scene: Scene) -> None:
    with scene.show(browser=False) as server:
        assert listening(server.pid) == {f"0100007F:{port_of(server.url):04X}"}


def test_the_page_is_served(scene: Scene) -> None:
    with scene.show(browser=False) as server:
        with urlopen(server.url, timeout=20) as answer:
            page = answer.read().decode()
        assert "a box" in page
        with urlopen(f"{server.url}main.min.js", timeout=20) as answer:
            assert len(answer.read()) > 500_000
        with urlopen(server.url.removesuffix("static/"), timeout=20) as answer:  # led to the page
            assert answer.url == server.url


def test_a_foreign_name_for_this_computer_is_refused(scene: Scene) -> None:
    with scene.show(browser=False) as server:
        port = port_of(server.url)
        assert get(server.url)[0] == 200
        assert get(server.url, Host=f"localhost:{port}")[0] == 200
        status, text = get(server.url, Host=f"evil.example:{port}")
        assert status == 404
        assert "a box" not in text


def test_pages_from_elsewhere_get_no_socket(scene: Scene) -> None:
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    with scene.show(browser=False) as server:
        own = f"http://127.0.0.1:{port_of(server.url)}"
        status, text = get(server.url, "/", Origin=own, **upgrade)
        assert status == 101
        assert "set_object" in text
        for origin in ("http://evil.example", "http://127.0.0.1:1", "null"):
            status, text = get(server.url, "/", Origin=origin, **upgrade)
            assert status == 403
            assert "set_object" not in text
        status, _ = get(server.url, "/", Origin="http://evil.example", Host="evil.example", **upgrade)
        assert status == 404


def ended(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text(encoding="ascii")


def test_nothing_is_left_when_it_is_closed(scene: Scene) -> None:
    server = scene.show(browser=False)
    pid, port = server.pid, port_of(server.url)
    assert server.running
    server.close()
    server.close()
    assert not server.running
    assert ended(pid)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=5)
    scene["box"].delete()  # and the scene does not mind


def test_nothing_is_left_when_the_caller_is_killed() -> None:
    """The pipe ends with whoever held it."""
    program = (
        "import time\nfrom aacmm_pin.report.scenes import Scene\n"
        "server = Scene('x').show(browser=False)\nprint(server.pid, flush=True)\ntime.sleep(100)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout is not None
        pid = int(caller.stdout.readline())
        assert not ended(pid)
        caller.kill()
    wait_until(lambda: ended(pid))


def wait_until(done: object, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not done():  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_scene_outlives_its_server(scene: Scene) -> None:
    with scene.show(browser=False) as server:
        os.kill(server.pid, signal.SIGKILL)
        wait_until(lambda: not server.running)
        scene["box"].set_object(Box([2.0, 2.0, 2.0]))
        scene["box"].delete()
    assert scene.commands == []


def test_a_server_that_does_not_start_is_an_error(scene: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text("raise SystemExit('no room at the inn')", encoding="utf-8")
    monkeypatch.setattr(serving_from.serving, "__file__", str(broken))
    with pytest.raises(AacmmError, match="did not start: no room at the inn"):
        scene.show(browser=False)


def test_meshcat_says_nothing(scene: Scene, capfd: pytest.CaptureFixture[str]) -> None:
    with scene.show(browser=False) as server, urlopen(server.url, timeout=20):
        pass
    assert capfd.readouterr() == ("", "")


def test_the_browser_is_opened_when_wanted(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url, new=0: opened.append(url))
    with scene.show() as server:
        assert opened == [server.url]
    with scene.show(browser=False):
        assert len(opened) == 1


def test_the_process_needs_nothing_of_the_package() -> None:
    source = Path(serving.__file__).read_text(encoding="utf-8")
    assert not re.search(r"^(from|import) aacmm_pin", source, re.MULTILINE)


# --- the command


def run(*words: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, ["show", *(str(word) for word in words)])
    return result.exit_code, result.stdout, result.stderr


def test_the_command_serves_until_it_is_interrupted() -> None:
    command = [sys.executable, "-m", "aacmm_pin.cli", "show", "sino6", *POINT, "--no-browser", "--count", "24"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        url = process.stdout.readline().strip()
        with urlopen(Request(url), timeout=20) as answer:
            assert "SINO6: wrist at 33.6, -671.9, 182.9 mm" in answer.read().decode()
        process.send_signal(signal.SIGINT)
        rest, said = process.communicate(timeout=60)
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in said
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port_of(url)), timeout=5)


def no_server(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a server was started")

    monkeypatch.setattr(Scene, "show", refuse)


def test_a_page_without_a_server(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    no_server(monkeypatch)
    target = tmp_path / "scene.html"
    assert run("sino6", *POINT, "--count", "12", "--shape", "zonotope", "-o", target)[:2] == (0, "")
    assert "everything that the parameters can do together" in target.read_text(encoding="utf-8")
    status, _, said = run("sino6", *POINT, "--count", "12", "-o", target)
    assert (status, "exists already" in said) == (1, True)
    tip = [*POINT, "--tip", "--axis", "0", "0", "-1", "--count", "12", "--force"]
    assert run("sino6", *tip, "-o", target)[0] == 0
    assert "SINO6: tip at" in target.read_text(encoding="utf-8")


def test_an_arm_without_uncertainties_is_shown_without_accuracy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    no_server(monkeypatch)
    words = ("zero6", "--point", "400", "0", "100", "--count", "12")
    status, _, said = run(*words, "-o", tmp_path / "scene.html")
    assert status == 0
    assert "shown without accuracy" in said
    assert run(*words, "--encoder-noise-rad", "1e-5", "-o", tmp_path / "noisy.html")[0] == 0
    assert "accuracy volume" not in (tmp_path / "scene.html").read_text(encoding="utf-8").split("scene-data")[0]


def test_one_posture_and_a_urdf(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, robot_file: object) -> None:
    no_server(monkeypatch)
    target = tmp_path / "scene.html"
    urdf = robot_file("ur5_robot.urdf")  # type: ignore[operator]
    theta = "10 -60, 70 -80 -90 5"
    assert run("--urdf", urdf, "--frame", "tool0", "--theta-deg", theta, "-o", target)[0] == 0
    q = np.radians([[10, -60, 70, -80, -90, 5]])
    assert scenes.arm_scene(Arm.from_urdf(urdf, "tool0"), q).title in target.read_text(encoding="utf-8")
    tip = Arm.from_urdf(urdf, "tool0").poses(q).position[0] * 1e3
    assert ", ".join(f"{c:.1f}" for c in tip) in target.read_text(encoding="utf-8")
    assert run("--urdf", robot_file("panda.urdf"), "--frame", "panda_hand", "-o", target, "--force")[0] == 0  # type: ignore[operator]
    assert "outside: joint" not in target.read_text(encoding="utf-8").split("scene-data")[1]


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["sino6", "--point", "0", "5000", "0"], 1, "no configuration"),
        (["sino6", "--theta-deg", "1 2 3"], 1, "--theta-deg has 3 numbers, expected 6"),
        (["sino6", "--theta-deg", "1 2 3 a 5 6"], 1, "expected 6 numbers"),
        (["sino6", *POINT, "--shape", "cube"], 1, "unknown shape 'cube'; known: ellipsoid, zonotope"),
        (["sino6", *POINT, "--theta-deg", "0 0 0 0 0 0"], 2, "exclude each other"),
        (["sino6", "--tip"], 2, "go with --point"),
        (["sino6", *POINT, "--tip"], 2, "--tip goes with --axis"),
        ([], 2, "expected ARM"),
        (["nobody", *POINT], 1, "nobody"),
    ],
)
def test_wrong_words(monkeypatch: pytest.MonkeyPatch, words: list[str], status: int, said: str) -> None:
    no_server(monkeypatch)
    found, out, error = run(*words)
    assert (found, out) == (status, "")
    assert said in re.sub(r"[│\s]+", " ", error)
