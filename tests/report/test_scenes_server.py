"""The server of a live scene: on loopback only, for its own pages only, gone when it is closed; and
the command.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
from meshcat.geometry import Box

from aacmm_pin import Arm
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Scene, Server
from tests.cli import shell

POINT = ["--point", "33.6323", "-671.8702", "182.9355"]


def port_of(url: str) -> int:
    return int(re.fullmatch(r"http://127\.0\.0\.1:(\d+)/", url)[1])


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens, from the kernel's own tables: hexadecimal, IPv4 and
    IPv6.
    """
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        if entry.exists() and (match := re.fullmatch(r"socket:\[(\d+)\]", os.readlink(entry))):
            inodes.add(match[1])
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in inodes:
                found.add(words[1])
    return found


def get(url: str, words: str = "GET /", **headers: str) -> tuple[int, str]:
    """Status and text of an answer; status 0 where the server breaks off."""
    host, port = "127.0.0.1", port_of(url)
    with socket.create_connection((host, port), timeout=20) as connection:
        every = {"Host": f"{host}:{port}", "Connection": "close"} | headers
        lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in every.items())
        connection.sendall(f"{words} HTTP/1.1\r\n{lines}\r\n".encode())
        try:
            answer = connection.recv(1 << 16)
            connection.shutdown(socket.SHUT_WR)  # a WebSocket would stay open
            while part := connection.recv(1 << 16):
                answer += part
        except ConnectionError:
            return 0, ""
    return int(answer.split()[1]), answer.decode(errors="replace")


@pytest.fixture
def scene() -> Scene:
    made = Scene("a box")
    made["box"].set_object(Box([1.0, 1.0, 1.0]))
    return made


@pytest.fixture
def server(scene: Scene) -> Iterator[Server]:
    with scene.show(browser=False) as server:
        yield server


def test_it_serves_this_computers_own_names_on_loopback_alone(scene, capfd):
    linux = Path("/proc/net/tcp").is_file()
    before = listening(os.getpid()) if linux else set()
    with scene.show(browser=False) as server:
        port = port_of(server.url)
        if linux:
            assert listening(os.getpid()) - before == {f"0100007F:{port:04X}"}
        for host, expected in (("127.0.0.1", 200), ("localhost", 200), ("evil.example", 404)):
            status, text = get(server.url, Host=f"{host}:{port}")
            assert (status, "a box" in text) == (expected, expected == 200)
    assert capfd.readouterr() == ("", "")


def test_pages_from_elsewhere_get_no_socket(server):
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "dGhlIHNhbXBsZSBub25jZQ==",
    }
    status, text = get(server.url, Origin=server.url.rstrip("/"), **upgrade)
    assert (status, "set_object" in text) == (101, True)
    for origin in ("http://evil.example", "http://127.0.0.1:1", "null"):
        status, text = get(server.url, Origin=origin, **upgrade)
        assert (status, "set_object" in text) == (403, False)
    assert get(server.url, Origin="http://evil.example", Host="evil.example", **upgrade)[0] == 404


def test_requests_that_no_page_makes_are_refused_unread(server):
    assert get(server.url, "POST /", Content_Length="90000000")[0] == 400
    assert get(server.url, X="x" * (1 << 20))[0] in (0, 400, 431)
    for words, status in (
        ("GET /%00", 404),
        ("GET /\0", 400),
        ("GET /../x", 404),
        ("PUT /", 405),
        ("nonsense", 400),
    ):
        assert get(server.url, words)[0] == status
    assert get(server.url)[0] == 200


def test_nothing_is_left_when_it_is_closed(scene, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url, new=0: opened.append(url))
    server = scene.show()
    assert opened == [server.url]
    assert server.running
    server.close()
    server.close()
    assert not server.running
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port_of(server.url)), timeout=5)
    scene["box"].delete()  # and the scene does not mind
    assert scene.commands == []


# --- the command


run = partial(shell.run, "show")


def test_the_command_serves_until_it_is_interrupted():
    command = [
        sys.executable,
        "-m",
        "aacmm_pin.cli",
        "show",
        "sino6",
        *POINT,
        "--no-browser",
        "--samples",
        "12",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
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


@pytest.fixture
def target(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A page to be written, without a server."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a server was started")

    monkeypatch.setattr(Scene, "show", refuse)
    return tmp_path / "scene.html"


def test_a_page_without_a_server(target):
    words = ["sino6", *POINT, "--samples", "12"]
    assert run(*words, "-o", target)[:2] == (0, "")
    assert "covers 95 %" in target.read_text(encoding="utf-8")
    status, _, said = run(*words, "-o", target)
    assert (status, "exists already" in said) == (1, True)
    assert run(*words, "--tip", "--axis", "0", "0", "-1", "--force", "-o", target)[0] == 0
    assert "SINO6: tip at" in target.read_text(encoding="utf-8")


def test_one_posture_and_a_urdf(target, robot_file):
    urdf = robot_file("ur5_robot.urdf")
    theta = "'10 -60, 70 -80 -90 5'"
    assert run("--urdf", urdf, "--frame", "tool0", "--theta-deg", theta, "-o", target)[0] == 0
    arm, q = Arm.from_urdf(urdf, "tool0"), np.radians([[10, -60, 70, -80, -90, 5]])
    assert scenes.arm_scene(arm, q).title in target.read_text(encoding="utf-8")
    tip = arm.poses(q).position[0] * 1e3
    assert ", ".join(f"{c:.1f}" for c in tip) in target.read_text(encoding="utf-8")
    assert (
        run("--urdf", robot_file("panda.urdf"), "--frame", "panda_hand", "-o", target, "--force")[0]
        == 0
    )
    assert "outside: joint" not in target.read_text(encoding="utf-8").split("scene-data")[1]
