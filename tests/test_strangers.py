"""Files from elsewhere, damaged in every way that comes to mind: read right, or refused by name."""

from __future__ import annotations

import io
import json
import os
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import strategies as st
from safetensors.torch import save_file

from ball_record import ball_record
from damage import damaged_bytes, damaged_json, fuzz, many, split, with_metadata
from neugrasp.baselines.vgn import PUBLIC_NAMES, load_vgn_head
from neugrasp.data.labels import labels_from_bytes, labels_to_bytes
from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.data.packing import pack
from neugrasp.data.records import read_record, write_record
from neugrasp.data.shards import Shards
from neugrasp.data.strict_json import DEEPEST, LARGEST, read_json
from neugrasp.data.truth_file import truth_from_bytes, truth_to_bytes
from neugrasp.data.world import scene_from_json, scene_to_json
from neugrasp.detection.files import read_grasps, write_grasps
from neugrasp.errors import InputError
from neugrasp.evaluation.episode import EMPTY, Attempt, Episode, read_episode, write_episode
from neugrasp.evaluation.results_io import NEEDED, facts_of
from neugrasp.exporters import graspnet, ros, ur, vgn
from neugrasp.geometry.pose import rigid
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import load_checkpoint, save_checkpoint
from neugrasp.model.config import ModelConfig
from neugrasp.model.grasp_head import GraspHead
from neugrasp.model.network import NeuGrasp
from neugrasp.simulation.lathe import box
from neugrasp.simulation.meshes import read_mesh, write_obj
from neugrasp.simulation.objects import FolderSet
from neugrasp.training.recipes import tiny

PANDA = Gripper.load("panda")
GRASP = Grasp(rigid(np.diag([1.0, -1, -1]), (0.1, 0.2, 0.3)), 0.05, 0.9)
ATTEMPT = Attempt(
    0, 0, 2, 5, 0.9, 0.04, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0, 1.0), True, "success", False, 0, 0.03,
    {"0.3": 0.1}, {"+0": {"0.3": 0.2}}, {"detect": 1.0}, {"kind": "pile", "bodies": []},
)  # fmt: skip


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "found.json"


def reading(file: Path, read: Callable[[Path], Any]) -> Callable[[str], Any]:
    def run(text: str) -> Any:
        file.write_text(text, encoding="utf-8")
        return read(file)

    return run


def check_grasps(grasps: list[Grasp]) -> None:
    for grasp in grasps:
        assert np.all(np.isfinite(grasp.pose))
        assert abs(np.linalg.det(grasp.pose[:3, :3]) - 1) < 1e-6
        assert type(grasp.width) is float
        assert 0 < grasp.width <= 1
        assert 0 <= grasp.score <= 1.001


@pytest.mark.slow
@many
def test_a_list_of_grasps(examples: int, file: Path):
    write_grasps(file, [GRASP, GRASP], {"scene": "s", "gripper": "panda", "rejected": {"too_narrow": 3}})
    right = json.loads(file.read_text())
    fuzz(reading(file, lambda f: check_grasps(read_grasps(f))), damaged_json(right), examples)


@pytest.mark.slow
@many
def test_a_list_of_grasps_for_ros(examples: int, file: Path):
    ros.write(file, [GRASP], PANDA, ros.Stamp("map", "hand"))
    right = json.loads(file.read_text())
    fuzz(reading(file, lambda f: check_grasps(ros.read(f, PANDA))), damaged_json(right), examples)


@pytest.mark.slow
@many
def test_a_list_of_grasps_for_ur(examples: int, file: Path):
    ur.write(file, [GRASP], PANDA, "tcp")
    right = json.loads(file.read_text())
    fuzz(reading(file, lambda f: check_grasps(ur.read(f, PANDA))), damaged_json(right), examples)


@pytest.mark.slow
@many
def test_lists_of_grasps_of_other_programs(examples: int, tmp_path: Path):
    for module, name in ((graspnet, "a.npy"), (vgn, "a.csv")):
        module.write(tmp_path / name, [GRASP, GRASP], PANDA)

        def read(data: bytes, module: Any = module, path: Path = tmp_path / name) -> None:
            path.write_bytes(data)
            for grasp in module.read(path, PANDA):
                assert np.all(np.isfinite(grasp.pose))

        fuzz(read, damaged_bytes((tmp_path / name).read_bytes()), examples // 2)


@pytest.mark.slow
@many
def test_a_gripper(examples: int, file: Path):
    right = json.loads((Path(__file__).parents[1] / "src/neugrasp/grippers/robotiq_2f85.json").read_text())
    fuzz(reading(file, Gripper.load), damaged_json(right), examples)


@pytest.mark.slow
@many
def test_a_round(examples: int, file: Path):
    write_episode(file, Episode(0, 2, EMPTY, (ATTEMPT,), "abc", "", {"detect": 1.0}, None))
    assert read_episode(file).attempts == (ATTEMPT,)
    fuzz(reading(file, read_episode), damaged_json(json.loads(file.read_text())), examples)


@pytest.mark.slow
@many
def test_the_description_of_an_evaluation(examples: int, tmp_path: Path):
    right = {
        "detector": "neugrasp",
        "scene": "packed",
        "materials": "diffuse",
        "views": "released",
        "gripper": "panda",
        "seed": 0,
        "object_sets": ["glassware"],
        "samples": 4,
    }
    read = reading(tmp_path / "run.json", lambda f: facts_of(f.parent, NEEDED))
    fuzz(read, damaged_json(right), examples)


@pytest.mark.slow
@many
def test_a_world(examples: int):
    right = json.loads(scene_to_json(ball_record(size=32).scene))
    fuzz(lambda text: scene_from_json(text, "world.json"), damaged_json(right), examples)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("records") / "a"
    write_record(folder, ball_record(size=32))
    return folder


@pytest.mark.slow
@many
def test_a_record(examples: int, record: Path, tmp_path: Path):
    """Whichever of its files is damaged."""
    for name in ("cell.json", "grasps.npz", "world.json"):
        right = (record / name).read_bytes()

        def read(data: bytes, path: Path = record / name) -> None:
            path.write_bytes(data)
            read_record(record)

        try:
            fuzz(read, damaged_bytes(right), examples // 3)
        finally:
            (record / name).write_bytes(right)


@pytest.mark.slow
@many
def test_an_index_of_shards(examples: int, tmp_path: Path):
    right = {
        "format": "neugrasp-shards",
        "version": 1,
        "records": [{"name": "a", "kind": "pile", "materials": ["diffuse"], "shard": "shard_0000.zip"}],
    }
    read = reading(tmp_path / "index.json", lambda f: [x.shard for x in Shards(f.parent).entries])
    fuzz(read, damaged_json(right), examples)


@pytest.mark.slow
@many
def test_a_shard(examples: int, record: Path, tmp_path: Path):
    pack([record.parent], tmp_path)
    path = tmp_path / "shard_0000.zip"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        Shards(tmp_path)[0]

    fuzz(read, damaged_bytes(path.read_bytes()), examples)


@pytest.mark.slow
@many
def test_what_a_shard_says_of_a_record(examples: int, record: Path, tmp_path: Path):
    """Its checksums are right, what it says is not."""
    pack([record.parent], tmp_path)
    path = tmp_path / "shard_0000.zip"
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    (described,) = (name for name in members if name.endswith("record.json"))

    def read(text: str) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in members.items():
                archive.writestr(name, text if name == described else data)
        Shards(tmp_path)[0]

    fuzz(read, damaged_json(json.loads(members[described])), examples)


@pytest.mark.slow
@many
def test_arrays(examples: int):
    made = ball_record(size=32)
    labels, truth = labels_to_bytes(made.labels), truth_to_bytes(made.truth, made.stereo)
    fuzz(lambda data: labels_from_bytes(data, "grasps.npz"), damaged_bytes(labels), examples)
    fuzz(lambda data: truth_from_bytes(data, "truth.npz"), damaged_bytes(truth), examples)


def npy(shape: tuple[int, ...], descr: str = "<f8", data: bytes = b"") -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue() + data


def zipped(**members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        npy((3,), data=bytes(24)),
        zipped(a=npy((10**12,))),
        zipped(a=npy((2**62,))),
        zipped(a=npy((3,), "<f8", bytes(7))),
        zipped(a=npy((3,), "|O", b"cos\nsystem\n(S'true'\ntR.")),
        zipped(a=npy((3,), "<i8", bytes(24))),
        zipped(a=npy((3,), "<c16", bytes(48))),
        zipped(a=npy((1,), "<U4", bytes(16))),
        zipped(a=npy((3,), "<f8", np.array([1.0, np.nan, 2]).tobytes())),
        zipped(a=npy((3,), "<f8", np.array([1.0, np.inf, 2]).tobytes())),
        zipped(b=npy((3,), data=bytes(24))),
        b"",
        b"PK\x05\x06" + bytes(18),
    ],
)
def test_arrays_that_are_none(data: bytes):
    with pytest.raises(InputError, match=r"a\.npz: "):
        npz_arrays(data, {"a": "f"}, "a.npz")


def test_arrays_of_the_named_kind_come_back():
    data = npz_bytes(a=np.arange(3.0), b=np.arange(3, dtype=np.uint8), c=np.array([True]))
    arrays = npz_arrays(data, {"a": "f", "b": "u", "c": "b"}, "a.npz")
    np.testing.assert_array_equal(arrays["a"], [0, 1, 2])


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "w.safetensors"
    save_checkpoint(path, NeuGrasp(tiny().model), {"threshold": 0.9, "recipe": "tiny", "steps": 20})
    return path


@pytest.mark.slow
@many
def test_weights(examples: int, weights: Path, tmp_path: Path):
    """Their header, their notes and their configuration, changed; the tensors themselves stay."""
    header, rest = split(weights)
    path = tmp_path / "w.safetensors"

    def read(metadata: dict[str, str]) -> None:
        read = load_checkpoint(with_metadata(path, header, rest, metadata))
        assert isinstance(read.config, ModelConfig)
        assert read.config.image_size % 16 == 0
        assert 0 <= read.about.get("threshold", 0.5) <= 1

    right = header["__metadata__"]
    words = st.one_of(
        st.text(max_size=5), st.sampled_from(["", "1", "-1", "0", "9" * 5000, "1.0", "null", "[]"])
    )
    changed = st.one_of(
        damaged_json(json.loads(right["config"])).map(lambda text: right | {"config": text}),
        damaged_json(json.loads(right["about"])).map(lambda text: right | {"about": text}),
        words.map(lambda word: right | {"version": word}),
        words.map(lambda word: right | {"format": word}),
        st.sampled_from(sorted(right)).map(lambda key: {k: v for k, v in right.items() if k != key}),
    ).filter(lambda metadata: all("\ud800" not in text for text in metadata.values()))
    fuzz(read, changed, examples)


@pytest.mark.slow
@many
def test_bytes_of_weights(examples: int, weights: Path, tmp_path: Path):
    data = weights.read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    path = tmp_path / "w.safetensors"

    def read(head: bytes) -> None:
        path.write_bytes(head + data[8 + size :])
        load_checkpoint(path)

    fuzz(read, damaged_bytes(data[: 8 + size]), examples)


@pytest.mark.parametrize(
    "kind", [torch.int8, torch.uint8, torch.bool, torch.int64, torch.complex64, torch.float8_e4m3fn]
)
def test_weights_are_floating_numbers(kind: torch.dtype, weights: Path, tmp_path: Path):
    """Cut to whole numbers they would still predict, and worse, without a word."""
    header, _ = split(weights)
    tensors = dict(NeuGrasp(tiny().model).state_dict())
    name = next(iter(tensors))
    tensors[name] = tensors[name].to(kind)
    path = tmp_path / "w.safetensors"
    save_file(tensors, path, header["__metadata__"])
    with pytest.raises(InputError, match=r"w\.safetensors: (tensor .* of type|not a readable)"):
        load_checkpoint(path)


@pytest.fixture(scope="module")
def public_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("vgn") / "vgn.pth"
    own = {ours: theirs for theirs, ours in PUBLIC_NAMES.items()}
    state = GraspHead(ModelConfig()).state_dict()
    torch.save({f"{own[k.rsplit('.', 1)[0]]}.{k.rsplit('.', 1)[1]}": t for k, t in state.items()}, path)
    return path


@pytest.mark.slow
@many
def test_public_weights(examples: int, public_weights: Path, tmp_path: Path):
    right = public_weights.read_bytes()[:4000]
    rest = public_weights.read_bytes()[4000:]
    path = tmp_path / "vgn.pth"

    def read(data: bytes) -> None:
        path.write_bytes(data + rest)
        load_vgn_head(path)

    fuzz(read, damaged_bytes(right), examples // 4)


@pytest.mark.parametrize(
    "state",
    [
        "some text\n" * 20,
        {"a": 1},
        [1, 2],
        None,
        "ints",
        "numbers",
        {1: torch.zeros(1)},
    ],
)
def test_public_weights_that_are_none(state: Any, public_weights: Path, tmp_path: Path):
    path = tmp_path / "vgn.pth"
    right = torch.load(public_weights, weights_only=True)
    if state == "ints":
        torch.save({name: tensor.long() for name, tensor in right.items()}, path)
    elif state == "numbers":
        torch.save(dict.fromkeys(right, 1), path)
    elif isinstance(state, str):
        path.write_text(state)
    else:
        torch.save(state, path)
    with pytest.raises(InputError, match=r"vgn\.pth: "):
        load_vgn_head(path)


URDF = """<robot name="x"><link name="b"><contact><lateral_friction value="0.7"/></contact>
<inertial><origin xyz="0 0 0.02" rpy="0 0 0"/><mass value="0.1"/></inertial>
<visual><origin xyz="0 0 0" rpy="0 0 0"/><geometry><mesh filename="a.obj" scale="1 1 1"/></geometry></visual>
<collision><geometry><mesh filename="a.obj"/></geometry></collision></link></robot>"""


@pytest.mark.slow
@many
def test_objects(examples: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A URDF, an OBJ, and STL of both kinds."""
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    write_obj(tmp_path / "a.obj", (box(np.full(3, 0.02)),))
    (mesh,) = read_mesh(tmp_path / "a.obj")
    facets = mesh.vertices[mesh.faces]
    binary = bytes(80) + struct.pack("<I", len(facets))
    binary += b"".join(struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in facets)
    text = "solid\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in facets.reshape(-1, 3)) + "endsolid\n"
    right = {
        "x.urdf": URDF.encode(),
        "y.obj": (tmp_path / "a.obj").read_bytes(),
        "y.stl": binary,
        "z.stl": text.encode(),
    }
    for name, data in right.items():
        path = tmp_path / name

        def read(found: bytes, path: Path = path) -> None:
            path.write_bytes(found)
            if path.suffix == ".urdf":
                model = FolderSet(tmp_path).model("x")
                assert 0 < model.mass < 100
                assert np.all(np.isfinite(model.centre_of_mass))
            else:
                for part in read_mesh(path):
                    assert np.all(np.isfinite(part.vertices))

        fuzz(read, damaged_bytes(data), examples // 4)


def test_one_reading_for_all(file: Path):
    """A byte order mark is none of the text; the rest of the JSON that readers differ in is refused."""
    file.write_bytes(b'\xef\xbb\xbf{"a": [1, 2.5, "\xc3\xa4"]}')
    assert read_json(file, "a list") == {"a": [1, 2.5, "\u00e4"]}
    nested = "[" * DEEPEST + "]" * DEEPEST
    file.write_text(nested[1:-1])
    read_json(file, "a list")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"version": 99, "version": 1}', "'version' is given twice"),
        (b'{"a": {"b": 1, "b": 1}}', "'b' is given twice"),
        (b"[NaN]", "NaN is not a finite number"),
        (b"[-Infinity]", "-Infinity is not a finite number"),
        (b"[1e999]", "1e999 is not a finite number"),
        (b"[" + b"9" * 5001 + b"]", "a number of 5001 digits"),
        (b"[" * (DEEPEST + 1) + b"]" * (DEEPEST + 1), f"more than {DEEPEST} deep"),
        (b"[" * 100_000, "deep"),
        (b'{"a":' * 100_000, "deep"),
        (b'["\\u001b[2J"]', "control character"),
        (b'{"a\\u0000": 1}', "control character"),
        (b'["\\ud800"]', "half a character"),
        ('["ä"]'.encode("utf-16"), "no text in UTF-8"),
        (b"\xff", "no text in UTF-8"),
        (b"", "not valid JSON"),
    ],
)
def test_json_that_is_refused(content: bytes, message: str, file: Path):
    file.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_json(file, "a list")
    assert str(caught.value).startswith(f"{file}: ")
    str(caught.value).encode("ascii", "strict")


def test_what_is_no_file_is_not_waited_for(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "big").touch()
    os.truncate(tmp_path / "big", LARGEST + 1)
    for name, message in (
        ("pipe", "is a pipe, a socket or a device"),
        ("", "is a folder"),
        ("none", "missing; a list is needed"),
        ("big/deeper", "missing"),
        ("big", "64 MiB; at most 64 are read"),
        ("n" * 300, "cannot be read .File name too long"),
        ("a\0b", "cannot be read .(stat: )?embedded null"),
    ):
        with pytest.raises(InputError, match=message):
            read_json(tmp_path / name, "a list")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": [0.1, 0.2, float("nan")]}, "NaN"),
        ({"position": [0.1, 0.2]}, r"grasps\[0\]\.position is not \[x, y, z\]"),
        ({"position": [0.1, 0.2, "0.3"]}, "position"),
        ({"position": [0.1, 0.2, True]}, "position"),
        ({"position": [0.1, 0.2, 10**400]}, "401 digits"),
        ({"position": [0.1, 0.2, 1e12]}, "position"),
        ({"quaternion_xyzw": [0, 0, 0, 0]}, "quaternion_xyzw has length 0; it must be 1"),
        ({"quaternion_xyzw": [2, 0, 0, 0]}, "has length 2"),
        ({"quaternion_xyzw": [1, 0, 0]}, "quaternion_xyzw is not"),
        ({"position": [100.0, 200.0, 300.0]}, "pregrasp_position is 373.8 m from position"),
        ({"pregrasp_position": [100.0, 200.0, 350.0]}, "pregrasp_position is 4.* m from position"),
        ({"pregrasp_position": [0.1, 0.2, 0.3]}, "pregrasp_position is 0 m from position"),
        ({"pregrasp_position": [0.1, 0.2]}, "pregrasp_position is not"),
        ({"quaternion_xyzw": [0, 0, 1, 0]}, "180 degrees off the approach"),
        ({"quaternion_xyzw": [0.5, 0.5, 0.5, 0.5]}, "90 degrees off the approach.*in another order"),
        ({"width": -1}, "width is -1"),
        ({"width": 0}, "width is 0"),
        ({"width": 40.0}, "width is 40"),
        ({"width": "0.04"}, "width is '0.04'"),
        ({"score": float("inf")}, "Infinity"),
        ({"score": 1.5}, "score is 1.5"),
        ({"score": -0.1}, "score is -0.1"),
        ({"score": None}, "score is None"),
        ({"unit": "mm"}, r"grasps\[0\]: 'unit' is a unit of length"),
        ({"quaternion_order": "wxyz"}, "'quaternion_order' is another convention"),
        ({"tcp_offset": [0, 0, 0.1]}, "'tcp_offset' is a motion"),
        ({"object_from_grasp": np.diag([-1, -1, 1, 1]).tolist()}, "'object_from_grasp' is a pose"),
    ],
)
def test_a_grasp_that_is_none_is_named_and_never_exported(change: dict[str, Any], message: str, file: Path):
    write_grasps(file, [GRASP])
    data = json.loads(file.read_text())
    data["grasps"][0] |= change
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match=message) as caught:
        read_grasps(file)
    assert "found.json" in str(caught.value)


def test_grasps_in_millimetres_of_another_program_are_refused(file: Path):
    write_grasps(file, [GRASP])
    data = json.loads(file.read_text())
    entry = {key: value for key, value in data["grasps"][0].items() if "pregrasp" not in key}
    for position in ([100, 200, 300], [41.2, -5.1, 13.3]):
        file.write_text(json.dumps({**data, "grasps": [{**entry, "position": position}]}))
        with pytest.raises(InputError, match=r"grasps\[0\]\.position is .* looks like millimetres"):
            read_grasps(file)
    # Our own grasps on a map whose origin is far away say where the hand comes from.
    far = Grasp(rigid(GRASP.pose[:3, :3], (5e5, 4e6, 300.0)), 0.05, 0.97)
    write_grasps(file, [far])
    assert read_grasps(file)[0].position.tolist() == [5e5, 4e6, 300.0]


@pytest.mark.parametrize("change", [{"units": "mm"}, {"scale": 0.001}, {"handed": "left"}, {"s\u0441ale": 2}])
def test_a_list_of_grasps_says_nothing_that_is_left_out(change: dict[str, Any], file: Path):
    write_grasps(file, [GRASP], {"scene": "s", "note": "by hand"})
    read_grasps(file)
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(InputError, match=f"found.json: {next(iter(change))!r} is"):
        read_grasps(file)
