"""The arm in 3D, in the browser or as a page."""

from __future__ import annotations

import webbrowser
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Annotated, Literal

import numpy as np
import typer

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.plausible import COORDINATE
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.accuracy import circle_accuracy
from aacmm_pin.arm import Arm
from aacmm_pin.cli.arm_options import EncoderNoise, UncertainArm, restrict_to_known_range
from aacmm_pin.cli.common import (
    Output,
    Replacing,
    Results,
    command,
    length_option,
    note,
    say,
    status,
)
from aacmm_pin.cli.pose_options import Orientation, Triple, note_wrist
from aacmm_pin.errors import AacmmError


@command(
    "aacmm-pin show sino6 --point 400 0 300 -o scene.html",
    'aacmm-pin show ur5 --theta-deg "0 -60 90 -90 0 0"',
)
def run(
    arm: UncertainArm,
    point: Annotated[
        Triple | None,
        length_option(
            "--point",
            "Show the postures that reach this point of the base frame, in mm.",
            COORDINATE,
            metavar="X Y Z",
        ),
    ] = None,
    *,
    orientation: Orientation,
    theta_deg: Annotated[
        str | None,
        typer.Option(
            metavar='"θ1 θ2 …"',
            help="Show one posture, in degrees (prismatic joints: mm). Default: 0 for all joints. "
            "If 0 is outside the limits of a joint, the default is the middle of all limits.",
        ),
    ] = None,
    noise: EncoderNoise,
    body_style: Annotated[
        Literal["meshes", "sticks"],
        typer.Option(
            help="Draw the meshes of the URDF, or tubes and joints. An arm without meshes is drawn "
            "as sticks."
        ),
    ] = "meshes",
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    output: Output = None,
    files: Replacing,
) -> None:
    """With -o, write a page that needs no network. Without -o, show the page in the browser of this
    computer until you press Ctrl-C (exit status 0).
    """
    from aacmm_pin.report import scenes  # loads meshcat

    if point is not None and theta_deg is not None:
        raise typer.BadParameter("--point cannot be combined with --theta-deg")
    if point is None and (orientation.tip or orientation.oriented):
        raise typer.BadParameter("--tip, --axis and --rpy-deg require --point")
    with Results(files, output) as results:
        model = restrict_to_known_range(arm.model())
        if point is None:
            scene = scenes.arm_scene(
                model, _posture(model.arm, theta_deg)[None], body_style=body_style
            )
        else:
            circle, accuracy = orientation.postures(model.arm, point), None
            note_wrist(circle)
            status(circle)
            try:
                accuracy = circle_accuracy(circle, model, encoder_noise=noise.encoder_noise)
            except AacmmError as error:
                note(f"the scene does not show the accuracy, because of an error: {error}")
            scene = scenes.circle_scene(circle, accuracy, body_style=body_style)
        if output is not None:
            results.text(scene.html(), output)
            return
    _serve(scene.html(), browser)


def _posture(arm: Arm, text: str | None) -> Array:
    """(nq,) [rad, m] stated in degrees (prismatic joints: mm), or the default."""
    if text is None:
        zero_allowed = (arm.limits[:, 0] <= 0) & (arm.limits[:, 1] >= 0)
        return np.zeros(arm.nq) if zero_allowed.all() else arm.limits.mean(axis=1)
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        raise AacmmError(
            f"--theta-deg {text!r}: expected {arm.nq} numbers, such as {' '.join(['0'] * arm.nq)!r}"
        ) from None
    if len(numbers) != arm.nq:
        raise AacmmError(
            f"--theta-deg {text!r}: {len(numbers)} numbers; expected {arm.nq}, one for each joint "
            f"of {arm.name}"
        )
    return np.array(numbers) * np.where(arm.chain.prismatic, MM, DEG)


def _serve(html: str, browser: bool) -> None:
    page = html.encode()

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Page) as server, suppress(KeyboardInterrupt):
        url = f"http://127.0.0.1:{server.server_port}/"
        say(url)
        status("To end the command, press Ctrl-C.")
        if browser:
            webbrowser.open(url, new=2)
        server.serve_forever()
