"""The viewer's command."""

from __future__ import annotations

from neugrasp.terminal import next_step
from neugrasp.viewer.app import serve, take_picture
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.door import free_port
from neugrasp.viewer.loaders import open_scene_data
from neugrasp.viewer.settings import Settings


def run(config: Viewer) -> str | None:
    """`neugrasp view`: the name of the picture, or nothing after the viewer was ended with Ctrl-C."""
    free_port(config.host, config.port)  # Known before the work.
    data = open_scene_data(config)
    settings = Settings(
        moment=config.moment,
        colouring=config.colour,
        shows_truth=config.truth,
        most=config.grasps,
        hand="whole hand" if config.hand == "whole" else config.hand,
    ).suited_to(data)
    if config.screenshot is not None:
        take_picture(config, data, settings)
        return f"{config.screenshot}\n{next_step('view', config.path, why='to turn it in the browser')}"
    serve(config, data, settings)
    return None
