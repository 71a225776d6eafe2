"""A live scene of meshcat's own server; and the command, which serves its page on loopback only."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
from meshcat.geometry import Box

from aacmm_pin import Arm
from aacmm_pin.report import scenes
from aacmm_pin.report.scenes import Scene
from tests.cli import shell

SENT = 'fetch("data:application'
POINT = ["--point", "33.6323", "-671.8702", "182.9355"]


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens, from the kernel's own tables: hexadecimal, IPv4 and
    IPv6.
    """
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        if entry.exists() and (match := re.fullmatch(r"socket:\[(\d+)\]", os.readlink(entry))):
            inodes.add(match[1])
    addresses = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and words[9] in inodes:
                addresses.add(words[1])
    return addresses


def test_a_live_scene_is_changed_by_its_visualizer(monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url, new=0: opened.append(url))
    scene = Scene("a box")
    scene["box"].set_object(Box([1.0, 1.0, 1.0]))
    scene["box"].set_transform(np.eye(4))
    live = scene.show()
    try:
        assert opened == [live.url()]
        assert live.static_html().count(SENT) == len(scene.commands) == 2
        live["box"].delete()
        assert SENT not in live.static_html()
    finally:
        live.window.zmq_socket.close()
        with live.window.server_proc as process:
            process.kill()


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
            assert "SINO6: wrist at 33.6, -671.9, 182.9\u00a0mm" in answer.read().decode()
        port = int(re.fullmatch(r"http://127\.0\.0\.1:(\d+)/", url)[1])
        if Path("/proc/net/tcp").is_file():
            assert listening(process.pid) == {f"0100007F:{port:04X}"}
        process.send_signal(signal.SIGINT)
        rest, said = process.communicate(timeout=60)
    assert process.returncode == 0
    assert rest == ""
    assert "Traceback" not in said
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=5)


@pytest.fixture
def target(tmp_path) -> Path:
    """A page to be written."""
    return tmp_path / "scene.html"


def test_a_page_without_a_server(target):
    words = ["sino6", *POINT, "--samples", "12"]
    assert run(*words, "-o", target)[:2] == (0, "")
    assert "covers 95\u00a0%" in target.read_text(encoding="utf-8")
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
