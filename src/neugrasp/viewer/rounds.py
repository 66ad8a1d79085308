"""A round of the decluttering benchmark as contents: a moment for each attempt, and what was left."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from neugrasp.data.world import Scene
from neugrasp.evaluation.episode import Attempt, Episode, read_episode
from neugrasp.evaluation.folder import NEEDED, facts_of, library_of, scene_of, workspace_of
from neugrasp.evaluation.rounds import Rounds
from neugrasp.geometry.pose import from_quaternion
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Frame
from neugrasp.viewer.bodies import COLOURS, Identity, identity, solids_of
from neugrasp.viewer.contents import Candidate, Colour, Contents, Moment, Solid
from neugrasp.viewer.reading import Choices


def round_contents(evaluation: Path, number: int, choices: Choices) -> Contents:
    """Round `number` of what `neugrasp evaluate` wrote. Raises `InputError` where it is not there."""
    facts = facts_of(evaluation, NEEDED)
    episode = read_episode(evaluation / "rounds" / f"{number:06d}.json")
    library = library_of(evaluation, choices.objects)
    workspace = workspace_of(facts)
    views = tuple(
        Frame(camera, name=f"camera {i}")  # Photos are not kept with a round.
        for i, camera in enumerate(Rounds.of_facts(facts, library).sensors(number, workspace))
    )
    return Contents(
        title=f"{evaluation.resolve().name}, round {number}",
        workspace=workspace,
        gripper=Gripper.load(choices.gripper or facts["gripper"]),
        views=views,
        moments=moments_of(episode, choices.objects),
    )


def moments_of(episode: Episode, objects: Path | None) -> tuple[Moment, ...]:
    """Every attempt with what lay there before it, then what was left."""
    colours = _colours(episode)
    moments = []
    for attempt in episode.attempts:
        words = f"attempt {attempt.attempt + 1} of {len(episode.attempts)}: {attempt.reason}"
        moments.append(
            Moment(words, grasps=(_candidate(attempt),), solids=_lying(attempt.before, objects, colours))
        )
    moments.append(Moment(f"the end: {episode.ending}", solids=_lying(episode.left, objects, colours)))
    return tuple(moments)


def _colours(episode: Episode) -> dict[Identity, Colour]:
    """One colour for each body, the same at all times."""
    times = [_scene(attempt.before) for attempt in episode.attempts] + [_scene(episode.left)]
    bodies = [identity(body) for scene in times if scene for body in scene.bodies]
    return {body: COLOURS[i % len(COLOURS)] for i, body in enumerate(dict.fromkeys(bodies))}


def _scene(lying: dict[str, Any] | None) -> Scene | None:
    if lying is None or not lying.get("bodies"):
        return None
    return scene_of(lying)


def _lying(
    lying: dict[str, Any] | None, objects: Path | None, colours: dict[Identity, Colour]
) -> tuple[Solid, ...]:
    scene = _scene(lying)
    return solids_of(scene, objects, colours) if scene else ()


def _candidate(attempt: Attempt) -> Candidate:
    pose = from_quaternion(attempt.quaternion_xyzw, attempt.position)
    note = f"{attempt.reason}; chosen among {attempt.candidates}"
    return Candidate(Grasp(pose, attempt.width, attempt.score), attempt.success, note)
