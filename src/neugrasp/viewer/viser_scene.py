"""The browser's three-dimensional scene: the only file that imports viser."""

from __future__ import annotations

import contextlib
import io
import logging
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import NeuGraspError, require
from neugrasp.geometry.pose import Array, to_quaternion
from neugrasp.viewer.door import free_port, guarded
from neugrasp.viewer.glb import glb
from neugrasp.viewer.primitives import AxesNode, LabelNode, LinesNode, MeshNode, Node, PictureNode
from neugrasp.viewer.scene_data import GraspMarker
from neugrasp.viewer.viewpoint import Viewpoint

PATIENCE = 300.0
"""Seconds that a browser may take to open the page, or to draw it. On an idle machine without a graphics card
it is some ten and one; on a busy one it can be minutes."""

LABEL = 0.011
"""Metres: the height of numbers in the scene."""
SHADOW = 0.3
"""How dark shadows are."""
Clicked = Callable[[GraspMarker], None]


class ViserScene:
    """A web server with one scene, which all browsers that visit it share."""

    def __init__(self, host: str, port: int | None, title: str):
        """Raises `MissingExtra` without viser, `InputError` where nobody can listen there."""
        viser = require("viser", extra="view")
        # A browser that hangs up in the middle of a greeting is no news.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        port = free_port(host, port)
        with contextlib.redirect_stdout(io.StringIO()), guarded(host):
            self._server: Any = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self._drawn: dict[str, tuple[Node, Any]] = {}
        self.gui: Any = self._server.gui
        self.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(38, 140, 96))
        self._light()

    @property
    def url(self) -> str:
        """Where to look."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def names(self) -> tuple[str, ...]:
        """What is drawn at the moment."""
        return tuple(self._drawn)

    def stand_at(self, viewpoint: Viewpoint) -> None:
        """Where new visitors stand at first."""
        camera = self._server.initial_camera
        camera.position, camera.look_at = viewpoint.eye, viewpoint.target
        camera.up, camera.fov = (0.0, 0.0, 1.0), viewpoint.field_of_view
        camera.near, camera.far = 0.01, 20.0

    def draw(self, nodes: Sequence[Node], clicked: Clicked) -> None:
        """Makes the scene show exactly these; what is the same object as before stays untouched."""
        wanted = {node.name: node for node in nodes}
        with self._server.atomic():
            for name, (node, handle) in list(self._drawn.items()):
                if wanted.get(name) is not node:
                    handle.remove()
                    del self._drawn[name]
            for name, node in wanted.items():
                if name not in self._drawn:
                    self._drawn[name] = (node, self._add(node, clicked))

    def on_aim(self, aimed: Callable[[Array, Array], None]) -> None:
        """Calls `aimed` with a line of sight, origin and direction, for each click with Shift held."""

        @self._server.scene.on_click(modifier="shift")
        def _(event: Any) -> None:
            aimed(np.array(event.ray_origin), np.array(event.ray_direction))

    def wait_for_visitor(self) -> Any:
        """The first browser that has the page open. Raises `NeuGraspError` where none comes in time."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if clients := self._server.get_clients():
                return next(iter(clients.values()))
            time.sleep(0.1)
        raise NeuGraspError(f"no browser opened {self.url} within {PATIENCE:.0f} s")

    def picture(self, viewpoint: Viewpoint, width: int, height: int) -> NDArray[np.uint8]:
        """RGBA (height, width, 4) of what a visitor sees from there, without ground and sky.

        Drawn again until nothing changes: pictures and coloured meshes arrive in the browser a little later.
        """
        client = self.wait_for_visitor()
        last = self._render(client, viewpoint, width // 4, height // 4)
        for _ in range(20):
            time.sleep(0.3)
            now = self._render(client, viewpoint, width // 4, height // 4)
            if np.array_equal(last, now):
                break
            last = now
        return self._render(client, viewpoint, width, height)

    def close(self) -> None:
        """Ends the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def _render(self, client: Any, viewpoint: Viewpoint, width: int, height: int) -> NDArray[np.uint8]:
        pose = viewpoint.pose()
        try:
            picture: NDArray[np.uint8] = client.get_render(
                height,
                width,
                wxyz=_wxyz(pose),
                position=pose[:3, 3],
                fov=viewpoint.field_of_view,
                transport_format="png",
                timeout=PATIENCE,
            )
        except (TimeoutError, RuntimeError) as error:
            raise NeuGraspError(f"the browser does not draw ({error}); its WebGL may not work") from error
        return picture

    def _light(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map("studio", environment_intensity=0.25)

    def _add(self, node: Node, clicked: Clicked) -> Any:
        match node:
            case MeshNode():
                return self._mesh(node, clicked)
            case PictureNode():
                return self._picture(node)
            case LinesNode():
                return self._server.scene.add_line_segments(
                    f"/{node.name}", node.segments, node.colour, thickness=node.thickness
                )
            case LabelNode():
                return self._server.scene.add_label(
                    f"/{node.name}",
                    node.text,
                    position=node.position,
                    font_size_mode="scene",
                    font_scene_height=LABEL,
                )
            case AxesNode():
                return self._server.scene.add_frame(
                    f"/{node.name}",
                    axes_length=node.length,
                    axes_radius=node.length / 20,
                    wxyz=_wxyz(node.pose),
                    position=node.pose[:3, 3],
                )

    def _picture(self, node: PictureNode) -> Any:
        scene, name = self._server.scene, f"/{node.name}"
        handle = scene.add_image(
            name,
            node.pixels,
            node.width,
            node.height,
            wxyz=_wxyz(node.pose),
            position=node.pose[:3, 3],
            cast_shadow=False,
        )
        if node.has_shadows:
            # Pictures take no shadow themselves; an invisible sheet on top does.
            x, y = node.width / 2, node.height / 2
            corners = np.array([(-x, -y, -0.0004), (x, -y, -0.0004), (x, y, -0.0004), (-x, y, -0.0004)])
            sheet = np.array([(0, 2, 1), (0, 3, 2)])
            scene.add_mesh_simple(
                f"{name}/shadows", corners, sheet, opacity=0.0, cast_shadow=False, receive_shadow=SHADOW
            )
        return handle

    def _mesh(self, node: MeshNode, clicked: Clicked) -> Any:
        scene, name = self._server.scene, f"/{node.name}"
        if len(node.surface.faces) == 0:
            return scene.add_frame(name, show_axes=False)
        if isinstance(node.colour, np.ndarray):
            return scene.add_glb(name, glb(node.surface, node.colour))
        handle = scene.add_mesh_simple(
            name,
            node.surface.vertices,
            node.surface.faces,
            color=node.colour,
            opacity=node.opacity if node.opacity < 1 else None,
            flat_shading=node.is_faceted,
            side="double",
        )
        marker = node.marker
        if marker is not None:
            handle.on_click(lambda _: clicked(marker))
        return handle


def _wxyz(pose: Array) -> Array:
    return np.roll(to_quaternion(pose), 1)
