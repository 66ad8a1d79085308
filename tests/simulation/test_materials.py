"""Materials: the mixes of the paper, parameters within Blender's ranges, one seed one look."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from neugrasp.data.world import Body, Scene, scene_from_json, scene_to_json
from neugrasp.errors import InputError
from neugrasp.simulation.blender_materials import INPUTS, PATTERNS
from neugrasp.simulation.materials import KINDS, MIXES, sample_material, sample_materials
from neugrasp.simulation.textures import OBJECT_PATTERNS, SCALES, TABLE_PATTERNS, sample_texture


def pile_of(count: int) -> Scene:
    body = Body("toys", "box", 1.0, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0, 1.0))
    return Scene("pile", 0, (body,) * count)


@pytest.mark.parametrize("mix", MIXES)
def test_a_mix_has_its_shares(mix: str):
    scene = sample_materials(pile_of(1500), mix, np.random.default_rng(0))
    seen = Counter(material.kind for material in scene.materials)
    assert len(scene.materials) == 1500
    for kind in KINDS:
        assert seen[kind] / 1500 == pytest.approx(MIXES[mix].get(kind, 0.0), abs=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_stay_in_the_ranges_of_the_shader(kind: str):
    rng = np.random.default_rng(1)
    for _ in range(300):
        parameters = sample_material(kind, rng).parameters
        assert all(0 <= c <= 1 for c in parameters["base_color"])
        for name in set(INPUTS) - {"base_color", "ior"}:
            assert 0 <= parameters.get(name, 0.0) <= 1, name
        if kind == "transparent":
            assert parameters["transmission"] == 1
            assert 1.31 <= parameters["ior"] <= 1.55
            assert parameters["roughness"] <= 0.1
        else:
            assert parameters.get("transmission", 0) == 0


def test_specular_materials_are_shinier_than_diffuse_ones():
    rng = np.random.default_rng(2)

    def shine(kind: str) -> float:
        drawn = [sample_material(kind, rng).parameters for _ in range(200)]
        return float(np.mean([p["roughness"] - 0.5 * p["coat"] - 0.5 * p["metallic"] for p in drawn]))

    assert shine("specular") < shine("diffuse") - 0.5


def test_one_seed_gives_one_look_and_another_seed_another():
    looks = [
        sample_materials(pile_of(5), "mixed", np.random.default_rng(seed)).materials for seed in (7, 7, 8)
    ]
    assert looks[0] == looks[1]
    assert looks[0] != looks[2]


def test_a_scene_with_materials_survives_json():
    scene = sample_materials(pile_of(12), "mixed", np.random.default_rng(3))
    assert scene_from_json(scene_to_json(scene)) == scene


def test_an_unknown_mix_names_the_choices():
    with pytest.raises(InputError, match="transparent-specular"):
        sample_materials(pile_of(1), "glassy", np.random.default_rng(0))


def test_every_pattern_can_be_drawn_and_built():
    patterns = set(TABLE_PATTERNS) | set(OBJECT_PATTERNS)
    assert patterns == set(PATTERNS) == set(SCALES)
    rng = np.random.default_rng(4)
    for pattern in patterns:
        texture = sample_texture(rng, (pattern,))
        assert json.loads(json.dumps(texture)) == texture
        assert np.shape(texture["colours"]) == (3, 3)
        assert SCALES[pattern][0] <= texture["scale"] <= SCALES[pattern][1]
