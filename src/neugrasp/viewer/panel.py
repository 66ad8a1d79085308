"""The controls beside the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from neugrasp.detection.options import Box
from neugrasp.pictures.score_scale import score_legend
from neugrasp.viewer.drawing import describe, grasps_of
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.settings import AXES, COLOURINGS, HANDS, Settings, most_grasps, scores

CLICK = "*Click on a gripper for its score, width and frame.*"
AIM = "*Shift and a click on an object: its grasps alone.*"


class Panel:
    """Controls that suit the data. `changed` is called with the new settings after each change."""

    def __init__(self, gui: Any, data: SceneData, settings: Settings, changed: Callable[[Settings], None]):
        self._gui, self._data, self._changed = gui, data, changed
        self._settings = settings
        self._controls: dict[str, Any] = {}
        """By the field of `Settings` that they set."""
        if len(data.moments) > 1:
            last = len(data.moments) - 1
            self._add("moment", gui.add_slider("time", 0, last, 1, settings.moment))
        self._said: Any = None
        self._chosen: Any = None
        self._caption = gui.add_markdown("")
        has_grid = any(moment.tsdf is not None for moment in data.moments)
        if most_grasps(data):
            self._grasps()
        if has_grid:
            self._surface()
            self._slices()
        self._shown()
        self.tell(settings)

    def tell(self, settings: Settings) -> None:
        """Brings the words up to date."""
        self._settings = settings
        data, moment = self._data, self._data.moment(settings.moment)
        shown = len(grasps_of(data, settings))
        if self._chosen is not None:
            self._chosen.content = AIM if settings.region is None else _region_words(settings.region)
        count = f"  \n{shown} of {len(moment.grasps)} grasps drawn" if moment.grasps else ""
        self._caption.content = moment.caption + count
        if self._said is not None:
            chosen = settings.selected
            self._said.content = describe(data, chosen) if chosen else CLICK

    @property
    def words(self) -> str:
        """What the panel says: of the moment, and of the grasp that was clicked."""
        parts = (self._caption, self._said, self._chosen)
        return "\n".join(str(part.content) for part in parts if part is not None)

    def set(self, field: str, value: Any) -> None:
        """Moves a control, as a visitor would."""
        self._controls[field].value = value

    def _add(self, field: str, control: Any) -> None:
        self._controls[field] = control
        control.on_update(lambda _: self._update())

    def _update(self) -> None:
        values = {field: control.value for field, control in self._controls.items()}
        settings = replace(self._settings, **values)
        if settings.moment != self._settings.moment:
            settings = replace(settings, selected=None)
        self._changed(settings)

    def _grasps(self) -> None:
        gui, now = self._gui, self._settings
        most = most_grasps(self._data)
        with gui.add_folder("Grasps"):
            low = float(np.floor(min(scores(self._data), default=1.0) * 100) / 100)
            if low < 1:
                self._add(
                    "threshold", gui.add_slider("least score", low, 1.0, 0.005, max(low, now.threshold))
                )
            if most > 1:
                self._add("most", gui.add_slider("at most", 0, most, 1, min(most, now.most)))
            self._add("hand", gui.add_dropdown("draw", HANDS, initial_value=now.hand))
            if any(c.outcome is None for moment in self._data.moments for c in moment.grasps):
                gui.add_image(score_legend())
            self._said = gui.add_markdown(CLICK)
            if any(moment.tsdf is not None for moment in self._data.moments):
                self._chosen = gui.add_markdown(AIM)

    def _surface(self) -> None:
        gui, now = self._gui, self._settings
        with gui.add_folder("Surface"):
            self._add("shows_surface", gui.add_checkbox("show", now.shows_surface))
            options = COLOURINGS if self._data.photos else ("plain", "confidence")
            self._add("colouring", gui.add_dropdown("colour", options, initial_value=now.colouring))
            label = "the table, too"
            self._add("shows_reconstructed_table", gui.add_checkbox(label, now.shows_reconstructed_table))

    def _slices(self) -> None:
        gui, now = self._gui, self._settings
        with gui.add_folder("Slice through the distances"):
            self._add("slice_axis", gui.add_dropdown("along", AXES, initial_value=now.slice_axis))
            last = self._data.workspace.resolution - 1
            self._add("slice_index", gui.add_slider("voxel", 0, last, 1, now.slice_index))

    def _shown(self) -> None:
        gui, now, truth = self._gui, self._settings, self._data.truth
        with gui.add_folder("ViewerApp"):
            for field in ("cameras", "table", "cube"):
                name = f"shows_{field}"
                self._add(name, gui.add_checkbox(field, getattr(now, name)))
            if truth.tsdf is not None or truth.solids:
                self._add("shows_truth", gui.add_checkbox("true surface", now.shows_truth))
            if truth.grasps:
                self._add("shows_true_grasps", gui.add_checkbox("true grasps", now.shows_true_grasps))


def _region_words(region: Box) -> str:
    """What makes `neugrasp predict` keep the same grasps."""
    edges = " ".join(f"{edge:g}" for edge in region)
    return f"**one object:** `--region {edges}`  \n*Shift and a click beside it: all.*"
