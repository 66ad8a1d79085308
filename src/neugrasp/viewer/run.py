"""The viewer's command."""

from __future__ import annotations

from neugrasp.terminal import next_step
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.door import free_port
from neugrasp.viewer.opening import open_contents
from neugrasp.viewer.settings import Settings
from neugrasp.viewer.show import serve, take_picture


def run(config: Viewer) -> str | None:
    """`neugrasp view`: the name of the picture, or nothing after the viewer was ended with Ctrl-C."""
    free_port(config.host, config.port)  # Known before the work.
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
        return f"{config.screenshot}\n{next_step('view', config.path, why='to turn it in the browser')}"
    serve(config, contents, settings)
    return None
