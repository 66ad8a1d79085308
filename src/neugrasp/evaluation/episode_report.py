"""One round in pictures: a single HTML file with everything inside."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.data.world import Scene
from neugrasp.errors import InputError
from neugrasp.evaluation.background_cache import background_folder
from neugrasp.evaluation.commands import InspectEpisode
from neugrasp.evaluation.episode import Attempt, Episode, read_episode
from neugrasp.evaluation.results_io import NEEDED, facts_of, library_of, scene_of, workspace_of
from neugrasp.evaluation.rounds import Round, Rounds
from neugrasp.geometry.pose import from_quaternion
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Image, View
from neugrasp.output import whole_file
from neugrasp.pictures.overlay import draw_grasps, photo_of_workspace
from neugrasp.pictures.score_scale import colour_of_outcome
from neugrasp.progress import counted
from neugrasp.robot.pick import SUCCESS
from neugrasp.simulation.cell_photos import SceneRenderer, backgrounds
from neugrasp.simulation.domain_renderer import domain_renderer
from neugrasp.simulation.lab import domain_of
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import RenderSettings
from neugrasp.terminal import next_step

WIDTH = 300
"""Pixels of a picture."""
COLOURS = np.array(
    [[150, 150, 150], [214, 110, 80], [90, 140, 200], [230, 190, 80], [110, 175, 110], [165, 120, 190]]
)
"""Colours of the table and of bodies, in pictures that show shape only."""
STYLE = """body{font:15px/1.4 system-ui,sans-serif;margin:2em auto;max-width:1300px;padding:0 1em;color:#222}
.attempt{border-left:6px solid #c0392b;padding:0 0 .5em 1em;margin:1.5em 0}.attempt.good{border-color:#27ae60}
.row{display:flex;flex-wrap:wrap;gap:8px}figure{margin:0}img{display:block;max-width:100%}figcaption{color:#666}"""


def run(config: InspectEpisode) -> str:
    """`neugrasp inspect-episode`: the file's name, and what to do next."""
    objects = [] if config.objects is None else ["--objects", config.objects]
    then = next_step("view", config.evaluation, "--round", config.round, *objects)
    return f"{write_episode_report(config)}\n{then}"


def write_episode_report(config: InspectEpisode, scene_renderer: SceneRenderer | None = None) -> Path:
    """Writes the file and returns its name. Everything is redone from the record of the round.

    Raises `InputError` where the evaluation, the round or its objects cannot be found.
    """
    facts = facts_of(config.evaluation, needs=(*NEEDED, "detector", "strategy", "protocol"))
    episode = read_episode(config.evaluation / "rounds" / f"{config.round:06d}.json")
    out = config.out or config.evaluation / "reports" / f"{config.round:06d}.html"
    library = library_of(config.evaluation, config.objects)
    wants_photos = config.photos == "yes" or (config.photos == "auto" and facts["detector"] == "neugrasp")
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {out}: a report is HTML; give a name that ends with .html")
    with ExitStack() as closing:
        part = closing.enter_context(whole_file(out))
        if wants_photos and scene_renderer is None:
            domain = domain_of(facts.get("domain", "training"))
            scene_renderer = closing.enter_context(domain_renderer(domain, _settings(facts)))
        replay = _Replay(facts, library, scene_renderer if wants_photos else None)
        closing.enter_context(replay.world)
        fixed = replay.fixed(episode.index)
        pictures = [replay.pictures(fixed, a.before, a) for a in counted(episode.attempts, "attempts")]
        left = replay.pictures(fixed, episode.left, None)
        part.write_text("\n".join(_page(facts, episode, pictures, left)), encoding="utf-8")
    return out


def _settings(facts: dict[str, Any]) -> RenderSettings:
    """How the photos of an evaluation are made, where it saw any."""
    return RenderSettings(samples=facts.get("samples", RenderSettings.samples))


class _Replay:
    """The world of an evaluation, into which its moments are laid again."""

    def __init__(self, facts: dict[str, Any], library: ObjectLibrary, scene_renderer: SceneRenderer | None):
        self.gripper = Gripper.load(facts["gripper"])
        self._scene_renderer = scene_renderer
        self._library = library
        self.world = World(workspace_of(facts), self._library, self.gripper)
        self._rounds = Rounds.of_facts(facts, self._library)
        self._settings = _settings(facts)

    def fixed(self, index: int) -> Round:
        """What is fixed about a round."""
        return self._rounds.make(index, self.world)

    def pictures(self, fixed: Round, lying: dict[str, Any] | None, attempt: Attempt | None) -> list[Image]:
        """What lay on the table at a moment, from every view, with the chosen grasp, green where it held and
        red where it did not; none where none lay."""
        if lying is None or not lying.get("bodies"):
            return []
        scene = scene_of(lying)
        self.world.reset(scene)
        views = self._photos(fixed, scene) if self._scene_renderer else self._shapes(fixed)
        grasps = [] if attempt is None else [_grasp(attempt)]
        colours = [] if attempt is None else [colour_of_outcome(attempt.success)]
        return [draw_grasps(view, grasps, self.gripper, WIDTH, colours) for view in views]

    def _photos(self, fixed: Round, scene: Scene) -> list[View]:
        assert self._scene_renderer is not None
        cell = fixed.cell
        folder = background_folder(cell, self._settings, self._rounds.domain.facts())
        empty = backgrounds(cell, folder, self._scene_renderer, self._library)
        photos = self._scene_renderer.render(cell, scene, self._library, range(cell.num_inputs))
        views = [View(c, p, b) for p, b, c in zip(photos, empty, cell.cameras, strict=False)]
        return [photo_of_workspace(view, self.world.workspace, WIDTH) for view in views]

    def _shapes(self, fixed: Round) -> list[View]:
        """Pictures from depth alone: one colour for each body, lit along the line of sight."""
        views = []
        for camera in fixed.sensors:
            depth, mask = self.world.depth_and_mask(camera)
            slope = np.hypot(*np.gradient(depth.astype(np.float64))) * camera.intrinsics[0, 0]
            light = 1 / np.sqrt(1 + np.minimum(slope / np.maximum(depth, 0.1), 4.0) ** 2)
            colour = np.where(mask[..., None] > 0, COLOURS[1 + (mask - 1) % (len(COLOURS) - 1)], COLOURS[0])
            shaded = (colour * (0.35 + 0.65 * light[..., None]) * (mask >= 0)[..., None]).astype(np.uint8)
            views.append(photo_of_workspace(View(camera, shaded, shaded), self.world.workspace, WIDTH))
        return views


def _grasp(attempt: Attempt) -> Grasp:
    return Grasp(from_quaternion(attempt.quaternion_xyzw, attempt.position), attempt.width)


def _page(
    facts: dict[str, Any], episode: Episode, pictures: list[list[Image]], left: list[Image]
) -> Iterator[str]:
    title = f"Round {episode.index}: {facts['detector']}, {facts['scene']}, {facts['materials']}"
    yield f"<!doctype html><html lang=en><meta charset=utf-8><title>{html.escape(title)}</title>"
    yield f"<style>{STYLE}</style><h1>{html.escape(title)}</h1>"
    told = ", ".join(f"{key} {facts[key]}" for key in ("strategy", "protocol", "views", "seed"))
    yield f"<p>{html.escape(told)}. {episode.objects} objects, {episode.successes} taken off the table. "
    yield f"The round ended: <b>{html.escape(episode.ending)}</b>. {html.escape(episode.error)}</p>"
    for attempt, images in zip(episode.attempts, pictures, strict=True):
        yield from _scene(attempt, images)
    if left:
        yield f"<section class=attempt><h2>Left on the table: {html.escape(episode.ending)}</h2>"
        yield from _row(left)
        yield "</section>"
    yield "</html>"


def _scene(attempt: Attempt, images: list[Image]) -> Iterator[str]:
    good = " good" if attempt.success else ""
    outcome = SUCCESS if attempt.success else f"failed: {attempt.reason}"
    yield f'<section class="attempt{good}"><h2>Attempt {attempt.attempt + 1}: {html.escape(outcome)}</h2>'
    facts = [
        f"{attempt.objects} objects on the table",
        f"chosen among {attempt.candidates} grasps, score {attempt.score:.2f}",
        f"predicted width {1000 * attempt.width:.0f} mm, {1000 * attempt.opening:.0f} mm at the end",
    ]
    if attempt.touched:
        facts.append("a contact stopped the hand on its way")
    if attempt.lost:
        facts.append(f"{attempt.lost} objects left the workspace ungrasped")
    if "0.3" in attempt.l1:
        facts.append(f"L1 of the surface {attempt.l1['0.3']:.3f}")
    yield f"<p>{html.escape('; '.join(facts))}.</p>"
    yield from _row(images)
    yield "</section>"


def _row(images: list[Image]) -> Iterator[str]:
    yield "<div class=row>"
    for number, image in enumerate(images):
        yield f"<figure><img src='{_inlined(image)}' alt='view {number}' width={WIDTH}>"
        yield f"<figcaption>view {number}</figcaption></figure>"
    yield "</div>"


def _inlined(image: Image) -> str:
    buffer = io.BytesIO()
    Picture.fromarray(image).save(buffer, "JPEG", quality=85)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()
