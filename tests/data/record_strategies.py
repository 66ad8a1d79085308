"""Hypothesis strategies for records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from neugrasp.data.labels import Labels
from neugrasp.data.records import Record, without_photos
from neugrasp.data.trials import COLUMNS, State, Trials
from neugrasp.data.truth_file import DEPTH_UNIT
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import on_sphere
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.scene import Body, Material, Scene

WORKSPACE = Workspace()


@st.composite
def records(draw: st.DrawFn, name: str = "scene-0") -> Record:
    """Small records with noise for images and numbers that survive the format's precision."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, m, size = draw(st.integers(1, 4)), draw(st.integers(1, 3)), draw(st.sampled_from([32, 48]))
    k, bodies = draw(st.integers(0, 5)), draw(st.integers(1, 4))
    truths = rng.uniform(-1, 1, (2, 40, 40, 40)).astype(np.float16).astype(np.float32)
    depths = rng.integers(0, 2**16, (n, size, size)).astype(np.float32) * np.float32(DEPTH_UNIT)
    return Record(
        name=name,
        scene=scene(draw, rng, bodies),
        cell={"index": draw(st.integers(0, 99)), "light": {"rotation": draw(st.floats(-3, 3))}},
        images=noise(rng, n, size),
        backgrounds=noise(rng, n, size),
        cameras=tuple(camera(rng, size) for _ in range(n)),
        targets=noise(rng, m, size),
        target_backgrounds=noise(rng, m, size),
        target_cameras=tuple(camera(rng, size) for _ in range(m)),
        depths=depths,
        masks=rng.integers(-1, bodies + 1, (n, size, size)).astype(np.int8),
        tsdf=truths[0],
        observed=rng.random((40, 40, 40)) < 0.7,
        labels=Labels(
            rng.uniform(0, 0.3, (k, 3)).astype(np.float32),
            rng.uniform(-1, 1, (k, 4)).astype(np.float32),
            rng.uniform(0, 0.08, k).astype(np.float32),
            rng.random(k) < 0.5,
        ),
        distance=truths[1] if draw(st.booleans()) else None,
        trials=draw(tables()) if draw(st.booleans()) else None,
    )


@st.composite
def tables(draw: st.DrawFn, seed: int | None = None) -> Trials:
    """Trials in one to three states, of one or two series; none at all now and then."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)) if seed is None else seed)
    k, states, series = draw(st.integers(0, 9)), draw(st.integers(1, 3)), draw(st.integers(1, 2))
    quaternions = rng.normal(size=(k, 4)).astype(np.float32)
    distances = rng.uniform(-1, 1, (states, 40, 40, 40)).astype(np.float16).astype(np.float32)
    names = draw(st.permutations(["success", "slipped", "nothing", "collision"]))[: draw(st.integers(1, 4))]
    return Trials(
        positions=rng.uniform(0, 0.3, (k, 3)).astype(np.float32),
        quaternions=quaternions,
        widths=rng.uniform(0, 0.08, k).astype(np.float32),
        success=rng.random(k) < 0.5,
        reasons=rng.integers(0, len(names), k).astype(np.uint8),
        states=rng.integers(0, states, k).astype(np.uint8),
        series=rng.integers(0, series, k).astype(np.uint8),
        reason_names=tuple(names),
        met=tuple(State(replace(scene(draw, rng, 2), materials=()), d) for d in distances),
        made=tuple({"source": "states", "seed": draw(st.integers(0, 3)), "series": i} for i in range(series)),
    )


@st.composite
def records_without_photos(draw: st.DrawFn, name: str = "scene-0") -> Record:
    """Such as `records`, of scenes that nobody photographed."""
    return replace(draw(records(name)), cell={"photos": False}, **without_photos())


def noise(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    return rng.integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def camera(rng: np.random.Generator, size: int) -> Camera:
    whole = on_sphere(WORKSPACE, rng.uniform(0.4, 0.5), rng.uniform(0.1, 1.2), rng.uniform(0, 6))
    return whole.cropped_and_resized(WORKSPACE.photo_box(whole), size, size)


def scene(draw: st.DrawFn, rng: np.random.Generator, count: int) -> Scene:
    kinds = st.sampled_from(["diffuse", "specular", "transparent"])
    bodies = tuple(
        Body("glassware", f"jar_{i:03d}", rng.uniform(), tuple(rng.random(3)), tuple(rng.random(4)))
        for i in range(count)
    )
    materials = tuple(Material(draw(kinds), "preset", {"roughness": rng.random()}) for _ in range(count))
    kind = draw(st.sampled_from(["single", "pile", "packed"]))
    return Scene(kind, draw(st.integers(0, 2**32)), bodies, materials)


def assert_same(one: Record, other: Record) -> None:
    """Every field equal, to the last bit."""
    assert (one.name, one.scene, dict(one.cell)) == (other.name, other.scene, dict(other.cell))
    for field in ("images", "backgrounds", "targets", "target_backgrounds", "masks", "observed", "tsdf"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field), err_msg=field)
    assert (one.distance is None) == (other.distance is None)
    if one.distance is not None:
        np.testing.assert_array_equal(one.distance, other.distance)
    assert (one.trials is None) == (other.trials is None)
    if one.trials is not None and other.trials is not None:
        assert_same_trials(one.trials, other.trials)
    for field in ("points", "quaternions", "widths", "success"):
        np.testing.assert_array_equal(getattr(one.labels, field), getattr(other.labels, field))
    np.testing.assert_allclose(one.depths, other.depths, atol=1e-6)
    pairs = zip(one.cameras + one.target_cameras, other.cameras + other.target_cameras, strict=True)
    for a, b in pairs:
        np.testing.assert_array_equal(a.intrinsics, b.intrinsics)
        np.testing.assert_array_equal(a.world_from_camera, b.world_from_camera)
        assert (a.width, a.height, a.sensed) == (b.width, b.height, b.sensed)


def assert_same_trials(one: Trials, other: Trials) -> None:
    """Every column, state and series equal, to the last bit."""
    for name, (kind, _) in COLUMNS.items():
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
        assert getattr(one, name).dtype == getattr(other, name).dtype == kind
    assert (one.reason_names, one.made) == (other.reason_names, other.made)
    for a, b in zip(one.met, other.met, strict=True):
        assert a.scene == b.scene
        np.testing.assert_array_equal(a.distance, b.distance)
