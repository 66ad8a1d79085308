"""The viewer as a whole: a scene in the browser, with a panel; kept open, or photographed."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace

import numpy as np
from PIL import Image as Picture

from neugrasp.data.scene_folder import photo_files
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.observation import Image
from neugrasp.output import whole_file
from neugrasp.viewer.aim import object_on_line
from neugrasp.viewer.browser import Browser
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.drawing import nodes_of
from neugrasp.viewer.panel import Panel
from neugrasp.viewer.scene_data import GraspMarker, SceneData
from neugrasp.viewer.settings import Settings
from neugrasp.viewer.viewpoint import viewpoint
from neugrasp.viewer.viser_scene import ViserScene

log = logging.getLogger(__name__)
SMALL = (480, 300)
"""Size of the browser's window where only the scene is wanted: it draws that all the time, besides."""
PAGE_ASPECT = 1.15
"""Aspect of the part of the page in which the scene is at first: the panel covers a strip on the right."""
OVERSAMPLING = 2
GROUND = np.array([255, 255, 255])


class ViewerApp:
    """SceneData in the browser, with what the visitor has chosen."""

    def __init__(self, data: SceneData, settings: Settings, host: str = "127.0.0.1", port: int | None = None):
        self.data, self.settings = data, settings
        self._lock = threading.Lock()
        self.scene = ViserScene(host, port, data.title)
        self.scene.stand_at(viewpoint(data, PAGE_ASPECT))
        self.scene.on_aim(self.aim)
        self.panel = Panel(self.scene.gui, data, settings, self.update)
        self.update(settings)

    def __enter__(self) -> ViewerApp:
        return self

    def __exit__(self, *_: object) -> None:
        self.scene.close()

    def update(self, settings: Settings) -> None:
        """Draws another state."""
        with self._lock:
            self.settings = settings
            self.scene.draw(nodes_of(self.data, settings), self.click)
            self.panel.tell(settings)

    def click(self, marker: GraspMarker) -> None:
        """Shows what there is to say of a grasp; of the same one again, nothing."""
        again = marker is self.settings.selected
        self.update(replace(self.settings, selected=None if again else marker))

    def aim(self, origin: Array, direction: Array) -> None:
        """Draws grasps only at the object on a line of sight; at all where it meets none."""
        moment = self.data.moment(self.settings.moment)
        found = None
        if moment.tsdf is not None:
            found = object_on_line(moment.tsdf, self.data.workspace, origin, direction)
        region = None if found is None else found.region(self.data.workspace)
        self.update(replace(self.settings, region=region, selected=None))

    def picture(self, width: int, height: int) -> Image:
        """RGB (height, width, 3) of what the first visitor sees, on white."""
        eye = viewpoint(self.data, width / height)
        large = self.scene.picture(eye, OVERSAMPLING * width, OVERSAMPLING * height)
        rgb, opacity = large[..., :3].astype(float), large[..., 3:] / 255
        flat = Picture.fromarray((rgb * opacity + GROUND * (1 - opacity)).round().astype(np.uint8))
        return np.asarray(flat.resize((width, height), Picture.Resampling.BOX))


def serve(viewer: Viewer, data: SceneData, settings: Settings) -> None:
    """Keeps the viewer open until Ctrl-C."""
    with ViewerApp(data, settings, viewer.host, viewer.port) as show:
        log.info("%s: open %s in a browser; Ctrl-C ends", data.title, show.scene.url)
        try:
            while True:
                time.sleep(3600)
        except KeyboardInterrupt:
            log.info("ended")


def take_picture(viewer: Viewer, data: SceneData, settings: Settings) -> None:
    """Writes the PNG file that `viewer.screenshot` names."""
    assert viewer.screenshot is not None
    if viewer.screenshot.suffix.lower() != ".png":
        raise InputError(f"--screenshot {viewer.screenshot}: is a PNG file; give a name that ends with .png")
    folders = [viewer.path, *([] if viewer.scene is None else [viewer.scene])]
    photos = [photo for folder in folders for photo in photo_files(folder)]
    with (
        whole_file(viewer.screenshot, photos) as part,
        ViewerApp(data, settings, viewer.host, viewer.port) as show,
        Browser(show.scene.url, viewer.browser, viewer.size if viewer.panel else SMALL) as browser,
    ):
        width, height = viewer.size
        if viewer.panel:
            show.picture(*SMALL)  # Comes when everything has arrived in the browser.
            image = browser.screenshot()
        else:
            image = show.picture(width, height)
        Picture.fromarray(image).save(part, optimize=True)
