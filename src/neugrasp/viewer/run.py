"""The viewer's command."""

from __future__ import annotations

from neugrasp.errors import InputError
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.opening import open_contents
from neugrasp.viewer.settings import Settings
from neugrasp.viewer.show import serve, take_picture


def run(config: Viewer) -> str | None:
    """`neugrasp view`: the name of the picture, or nothing after the viewer was ended with Ctrl-C."""
    if not 0 <= config.port < 2**16:
        raise InputError(f"--port {config.port}: must be from 0 to 65535")
    contents = open_contents(config)
    settings = Settings(
        moment=config.moment,
        colouring=config.colour,
        shows_truth=config.truth,
        most=config.grasps,
        hand="whole hand" if config.hand == "whole" else config.hand,
    ).suited_to(contents)
    if config.screenshot is not None:
        take_picture(config, contents, settings)
        return str(config.screenshot)
    serve(config, contents, settings)
    return None
