"""A run as it goes on, in the browser: photos, surface, chosen grasp, what the arm does, and a button that
stops it."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.detection.contract import Detection
from neugrasp.evaluation.episode import Episode
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, Views
from neugrasp.robot.attended import Step
from neugrasp.robot.errors import Stopped
from neugrasp.robot.interface import Arm
from neugrasp.viewer.drawing import nodes_of
from neugrasp.viewer.loaders import in_workspace
from neugrasp.viewer.scene_data import GraspMarker, SceneData, Snapshot
from neugrasp.viewer.settings import Settings
from neugrasp.viewer.viewpoint import viewpoint
from neugrasp.viewer.viser_scene import ViserScene

PAGE_ASPECT = 1.15
SETTINGS = Settings(colouring="plain", hand="whole hand")
STOPPED = "stopped by the button on the page; nothing moves until the program is started again"
THUMBNAIL = 320
"""Pixels of the width of a photo beside the scene."""


class LivePage:
    """An attendant who shows what it hears. Use as a context: leaving it closes the page."""

    def __init__(self, title: str, workspace: Workspace, gripper: Gripper, host: str, port: int | None):
        """Raises `MissingExtra` without viser, `InputError` where nobody can listen there."""
        self._data = SceneData(title, workspace, gripper, moments=(Snapshot("nothing seen yet"),))
        self._world = workspace
        self._arms: list[Arm] = []
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._scene = ViserScene(host, port, title)
        gui = self._scene.gui
        self._button = gui.add_button("STOP", color="red", hint="ends the motion under way, and the run")
        self._button.on_click(lambda _: self.stop())
        self._state = gui.add_markdown("**starting**")
        self._counts = gui.add_markdown("no pick yet")
        self._photos: Any = None
        self._scene.stand_at(viewpoint(self._data, PAGE_ASPECT))
        self._draw()

    def __enter__(self) -> LivePage:
        return self

    def __exit__(self, *_: object) -> None:
        self._scene.close()

    @property
    def url(self) -> str:
        """Where to look."""
        return self._scene.url

    def stop(self) -> None:
        """Stops every arm at once, also one that is met later. From whichever thread."""
        self._stopped.set()
        with self._lock:
            arms = tuple(self._arms)
        for arm in arms:
            arm.stop()
        self._say(STOPPED)

    def meet(self, arm: Arm) -> None:
        """The arm that the button stops."""
        with self._lock:
            self._arms.append(arm)
        if self._stopped.is_set():
            arm.stop()

    def before(self, step: Step) -> None:
        """Says what moves; draws the grasp that is begun.

        Raises `Stopped` after the button was pressed: what is no arm obeys it, too.
        """
        if self._stopped.is_set():
            raise Stopped(STOPPED)
        if step.grasp is not None:
            self._choose(step.grasp)
        self._say(f"moving: {step.what}" if step.grasp is None else f"chosen: {step.what}")

    def stage(self, name: str, content: object) -> None:
        """Says what a round does, and draws what it looks at: `Views`, then a `Detection`."""
        self._say(name)
        if isinstance(content, Views):
            self._see(content)
        elif isinstance(content, Detection):
            self._detect(content)

    def told(self, episode: Episode) -> None:
        """Counts, after every pick."""
        picks, last = len(episode.attempts), episode.attempts[-1]
        passed = ", ".join(f"{count} {reason}" for reason, count in episode.skipped.items()) or "none"
        self._counts.content = (
            f"{episode.successes} of {picks} picks held  \nthe last: {last.reason}  \n"
            f"grasps passed over: {passed}"
        )

    def _say(self, words: str) -> None:
        self._state.content = f"**{STOPPED if self._stopped.is_set() else words}**"

    def _see(self, views: Views) -> None:
        moment = Snapshot(f"{len(views)} photos")
        self._world = views.workspace
        self._data = replace(self._data, views=in_workspace(views), moments=(moment,))
        sheet = _sheet([view.image for view in views.frames])
        if self._photos is None:
            self._photos = self._scene.gui.add_image(sheet, label="photos", format="jpeg")
        else:
            self._photos.image = sheet
        self._draw()

    def _detect(self, detection: Detection) -> None:
        self._world = detection.workspace
        best = tuple(self._marker(grasp) for grasp in list(detection.grasps)[: SETTINGS.most])
        moment = Snapshot(f"{len(detection.grasps)} grasps", detection.tsdf, best)
        self._data = replace(self._data, gripper=detection.gripper, moments=(moment,))
        self._draw()

    def _choose(self, grasp: Grasp) -> None:
        moment = replace(self._data.moments[0], grasps=(self._marker(grasp),))
        self._data = replace(self._data, moments=(moment,))
        self._draw()

    def _marker(self, grasp: Grasp) -> GraspMarker:
        return GraspMarker(grasp.moved(inverse(self._world.world_from_workspace)))

    def _draw(self) -> None:
        self._scene.draw(nodes_of(self._data, SETTINGS), lambda _: None)


def _sheet(photos: list[Image]) -> Image:
    """Two photos a row, small."""
    height = round(THUMBNAIL * photos[0].shape[0] / photos[0].shape[1])
    small = [np.asarray(Picture.fromarray(photo).resize((THUMBNAIL, height))) for photo in photos]
    small += [np.full_like(small[0], 255)] * (len(small) % 2)
    return np.concatenate([np.concatenate(small[i : i + 2], axis=1) for i in range(0, len(small), 2)])
