"""A user's URDF means here what it means to the physics engine itself, or is refused by name."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.data.world import Body
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.lathe import box
from neugrasp.simulation.mesh_checks import SIZES
from neugrasp.simulation.meshes import Mesh, merged, read_mesh, read_obj, write_obj
from neugrasp.simulation.object_urdf import FRICTIONS, MASSES
from neugrasp.simulation.objects import FolderSet, ObjectLibrary
from neugrasp.simulation.physics import World

ORIGIN = '<origin xyz="{}" rpy="{}"/>'
SLANTED = ("0.3 -0.7 1.1", "0.2 0.4 -0.5")
AT = (0.15, 0.15, 0.2)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
LYING = (0.18257419, 0.36514837, 0.54772256, 0.73029674)


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))


def brick() -> Mesh:
    """4 x 6 x 10 cm, its corners at different distances from the origin."""
    return box(np.array([0.02, 0.03, 0.05])).transformed(1.0, np.array([0.004, -0.003, 0.006]))


def bowl() -> tuple[Mesh, ...]:
    """A floor and four walls, each a convex part."""
    walls = ((0.028, 0.0, 0.03), (-0.028, 0.0, 0.03), (0.0, 0.028, 0.03), (0.0, -0.028, 0.03))
    halves = ((0.002, 0.03, 0.03), (0.002, 0.03, 0.03), (0.026, 0.002, 0.03), (0.026, 0.002, 0.03))
    parts = [(box(np.array([0.026, 0.026, 0.002])), (0.0, 0.0, 0.002))]
    parts += [(box(np.array(half)), place) for half, place in zip(halves, walls, strict=True)]
    return tuple(part.transformed(1.0, np.array(place)) for part, place in parts)


def stl(mesh: Mesh, binary: bool = True) -> bytes:
    corners = mesh.vertices[mesh.faces]
    if not binary:
        facets = [
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in facet)
            + "endloop\nendfacet\n"
            for facet in corners
        ]
        return ("solid brick\n" + "".join(facets) + "endsolid brick\n").encode()
    facets = [struct.pack("<12fH", 0, 0, 0, *facet.ravel(), 0) for facet in corners]
    return b"solid, says the header".ljust(80) + struct.pack("<I", len(corners)) + b"".join(facets)


def urdf(mesh: str = "a.obj", touched: str = "", scale: str = "", mass: str = "0.2", **origins: str) -> str:
    """Origins of `visual`, `collision` and `inertial`."""
    at = {role: origins.get(role, "") for role in ("visual", "collision", "inertial")}
    size = f' scale="{scale}"' if scale else ""
    return f"""<robot name="thing"><link name="base"><contact><lateral_friction value="0.7"/></contact>
<inertial>{at["inertial"]}<mass value="{mass}"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual>{at["visual"]}<geometry><mesh filename="{mesh}"{size}/></geometry></visual>
<collision>{at["collision"]}<geometry><mesh filename="{touched or mesh}"{size}/></geometry></collision>
</link></robot>"""


numbers = count()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of its own name for every object: the engine keeps files that it has read by their name."""
    inside = tmp_path / f"objects_{next(numbers)}"
    inside.mkdir()
    write_obj(inside / "a.obj", (brick(),))
    write_obj(inside / "bowl.obj", bowl())
    groups = (inside / "bowl.obj").read_text().replace("o part", "g part")
    (inside / "groups.obj").write_text(groups)
    write_obj(inside / "mm.obj", (brick().transformed(1000.0, np.zeros(3)),))
    write_obj(inside / "c.OBJ", (brick(),))
    (inside / "a.STL").write_bytes(stl(brick()))
    (inside / "b.stl").write_bytes(stl(brick(), binary=False))
    return inside


@pytest.fixture(scope="module")
def engine() -> Iterator[Any]:
    """The physics engine by itself."""
    pytest.importorskip("pybullet")
    from pybullet_utils.bullet_client import BulletClient

    client = BulletClient(connection_mode=pytest.importorskip("pybullet").DIRECT)
    yield client
    client.disconnect()


CASES = {
    "plain": urdf(),
    "collision moved": urdf(collision=ORIGIN.format("-0.01 0.005 0.002", "0 0 0")),
    "both turned": urdf(
        visual=ORIGIN.format("0 0 0", "1.5707963 0 0"), collision=ORIGIN.format("0 0 0", "1.5707963 0 0")
    ),
    "both slanted": urdf(
        visual=ORIGIN.format("0.02 0 0.01", SLANTED[0]), collision=ORIGIN.format("0.02 0 0.01", SLANTED[0])
    ),
    "visual turned alone": urdf(visual=ORIGIN.format("0.001 0 0", SLANTED[1])),
    "a corner is the origin": urdf(
        visual=ORIGIN.format("0.02 0.03 0.05", "0 0 0"),
        collision=ORIGIN.format("0.02 0.03 0.05", "0 0 0"),
        inertial=ORIGIN.format("0.024 0.027 0.1", "0 0 0"),
    ),
    "inertia turned": urdf(inertial=ORIGIN.format("0.004 -0.003 0.0", SLANTED[0])),
    "millimetres": urdf("mm.obj", scale="0.001 0.001 0.001"),
    "one scale for all": urdf("mm.obj", scale="0.001"),
    "three scales": urdf(scale="1.5 0.5 1"),
    "scaled and moved": urdf(
        "mm.obj",
        scale="0.001 1e-3 .001",
        visual=ORIGIN.format("0.01 0.02 0.03", SLANTED[1]),
        collision=ORIGIN.format("0.01 0.02 0.03", SLANTED[1]),
    ),
    "mirrored": urdf(scale="-1 1 1"),
    "binary STL": urdf("a.STL"),
    "a suffix in capitals": urdf("c.OBJ"),
    "STL, moved": urdf("a.STL", "a.obj", collision=ORIGIN.format("0.01 0 0", SLANTED[0])),
    "hollow, moved": urdf("bowl.obj", collision=ORIGIN.format("0.002 0.001 -0.001", "0 0 0.5")),
    "hollow by groups, moved": urdf("groups.obj", collision=ORIGIN.format("0.002 0.001 -0.001", "0 0 0.5")),
}


def depth_of(engine: Any, camera: Camera) -> np.ndarray:
    from neugrasp.simulation.depth import rendered

    return rendered(engine, camera)[0]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("quaternion", [UPRIGHT, LYING], ids=["upright", "lying"])
def test_an_object_is_what_the_engine_itself_makes_of_its_urdf(
    case: str, quaternion: tuple[float, float, float, float], folder: Path, engine: Any
) -> None:
    """Shape, place, centre of mass, inertia and what a camera sees, beside the untouched file."""
    (folder / "x.urdf").write_text(CASES[case])
    engine.resetSimulation()
    own = engine.loadURDF(str(folder / "x.urdf"))
    centre, turn = engine.getDynamicsInfo(own, -1)[3:5]
    engine.resetBasePositionAndOrientation(own, *engine.multiplyTransforms(AT, quaternion, centre, turn))
    camera = Camera(
        np.array([[300.0, 0, 79.5], [0, 300.0, 59.5], [0, 0, 1]]), look_at((0.4, 0.0, 0.45), AT), 160, 120
    )
    body = Body("folder", "x", 1.0, AT, quaternion)
    with World(Workspace(), ObjectLibrary((FolderSet(folder),))) as world:
        world.add(body)
        ours, uid = world._client, world._placed[0].uid
        np.testing.assert_allclose(ours.getAABB(uid), engine.getAABB(own), atol=2e-6)
        for quantity in (0, 1, 2):  # mass, friction, diagonal of the inertia
            np.testing.assert_allclose(
                ours.getDynamicsInfo(uid, -1)[quantity], engine.getDynamicsInfo(own, -1)[quantity], rtol=1e-4
            )
        for one, other in zip(
            ours.getBasePositionAndOrientation(uid), engine.getBasePositionAndOrientation(own), strict=True
        ):
            np.testing.assert_allclose(one, other, atol=1e-6)
        (back,) = world.bodies()
        np.testing.assert_allclose(back.position, body.position, atol=1e-9)
        np.testing.assert_allclose(back.quaternion_xyzw, body.quaternion_xyzw, atol=1e-9)
        seen, expected = depth_of(ours, camera), depth_of(engine, camera)
    if case == "mirrored":
        return  # The engine shows such a mesh from its inside.
    on_both = np.isfinite(seen) & np.isfinite(expected)
    assert on_both.sum() > 300
    assert (np.isfinite(seen) != np.isfinite(expected)).mean() < 1e-3
    assert np.percentile(np.abs(seen[on_both] - expected[on_both]), 99) < 1e-4


@pytest.mark.parametrize("mesh", ["bowl.obj", "groups.obj"])
@pytest.mark.parametrize("moved", ["", ORIGIN.format("0 0 0.001", "0 0 0")], ids=["plain", "moved"])
def test_what_is_hollow_stays_hollow(mesh: str, moved: str, folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf(mesh, visual=moved, collision=moved))
    with World(Workspace(), ObjectLibrary((FolderSet(folder),))) as world:
        world.add(Body("folder", "x", 1.0, (0.15, 0.15, 0.05), UPRIGHT))
        (hit,) = world._client.rayTest([0.15, 0.15, 0.3], [0.15, 0.15, 0.0])
    assert hit[3][2] < 0.06


@pytest.mark.parametrize(
    "spelling", ["1 1 1", "1.0 1.0 1.0", "1 1 1.0", "1.000 1.000 1.000", "1. 1. 1.", "1e0"]
)
def test_a_scale_of_1_is_none_however_it_is_spelt(spelling: str, folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf(scale=spelling))
    assert FolderSet(folder).model("x").visual_mesh == folder / "a.obj"


@pytest.mark.parametrize("moved", ["", ORIGIN.format("0.01 0 0", SLANTED[0])], ids=["plain", "moved"])
def test_text_stl_which_the_engine_does_not_read_is_a_body_all_the_same(moved: str, folder: Path) -> None:
    boxes = []
    for name in ("b.stl", "a.obj"):
        (folder / f"{name}.urdf").write_text(urdf(name, visual=moved, collision=moved))
        with World(Workspace(), ObjectLibrary((FolderSet(folder),))) as world:
            world.add(Body("folder", name, 1.0, AT, LYING))
            boxes.append(world._client.getAABB(world._placed[0].uid))
    np.testing.assert_allclose(boxes[0], boxes[1], atol=0.002)  # the engine's margins
    assert np.ptp(boxes[0], axis=0).min() > 0.05


@pytest.mark.parametrize("name", ["a.STL", "b.stl"])
def test_stl_is_the_same_mesh_as_obj(name: str, folder: Path) -> None:
    (read,) = read_mesh(folder / name)
    (wanted,) = read_mesh(folder / "a.obj")
    assert read.is_closed()
    assert len(read.vertices) == len(wanted.vertices)
    assert read.volume_and_centroid()[0] == pytest.approx(wanted.volume_and_centroid()[0], rel=1e-5)


def test_a_mirrored_mesh_is_right_side_out(folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf(scale="1 -1 1"))
    mesh = merged(read_obj(FolderSet(folder).model("x").visual_mesh))
    assert mesh.volume_and_centroid()[0] == pytest.approx(0.04 * 0.06 * 0.10)


@pytest.mark.parametrize(
    "name", ["package://things/a.obj", "package://things/meshes/b.obj", "model://things/a.obj"]
)
def test_a_package_is_a_folder_above_or_beside(name: str, tmp_path: Path) -> None:
    things = tmp_path / "objects" / "things"
    write_obj(things / "a.obj", (brick(),))
    write_obj(things / "meshes" / "b.obj", (brick(),))
    (things / "x.urdf").write_text(urdf(name))
    assert FolderSet(tmp_path / "objects").model("things/x").visual_mesh.is_relative_to(things)
    (tmp_path / "objects" / "y.urdf").write_text(urdf(name))
    assert FolderSet(tmp_path / "objects").model("y").visual_mesh.is_relative_to(things)


def text_of(mesh: Mesh) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in mesh.faces + 1)]) + "\n"


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def half_turned(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, np.concatenate([mesh.faces[:3, ::-1], mesh.faces[3:]]))


def flat(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices * [1, 1, 0], mesh.faces)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (text_of(brick().transformed(1000.0, np.zeros(3))), "40 x 60 x 100 m in size .*millimetres"),
        (text_of(brick().transformed(100.0, np.zeros(3))), "4 x 6 x 10 m in size .*centimetres"),
        (text_of(brick().transformed(0.001, np.zeros(3))), "in size .*metres, scaled as if"),
        (text_of(brick().transformed(1e6, np.zeros(3))), f"must be from {SIZES[0]:g} to {SIZES[1]:g} m"),
        (text_of(brick().transformed(0.0, np.zeros(3))), "must be from"),
        (text_of(brick().transformed(1.0, np.array([5.0, 0, 0]))), "from its link's origin"),
        (text_of(inside_out(brick())), "inside out"),
        (text_of(half_turned(brick())), "some faces are inside out"),
        (text_of(flat(brick())), "flat"),
        (text_of(brick()) + "v nan 0 0\n", "not a finite number"),
        (text_of(brick()) + "v inf 0 0\n", "not a finite number"),
        (text_of(brick()) + "v 1e308 0 0\n", "not a finite number, or beyond"),
        (text_of(brick()) + f"f 1 2 {'9' * 30}\n", "not a mesh in OBJ format"),
        (text_of(brick()) + "f 0 1 2\n", "counted from 1"),
        (text_of(brick()) + "v 1 2\n", "not a mesh in OBJ format"),
        ("", "is empty"),
        ("v 0 0 0\nv 0 0 1\n", "is empty"),
        ("\0\1\2" * 100, "is empty"),
    ],
)
def test_a_mesh_that_is_no_body_is_named(content: str, message: str, folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf("bad.obj"))
    (folder / "bad.obj").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        FolderSet(folder).model("x")
    assert "bad.obj" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a mesh in STL format"),
        (b"solid nothing\nendsolid\n", "is empty"),
        (stl(brick())[:-7], "not a mesh in STL format|is empty"),
        (b"x" * 80 + struct.pack("<I", 2**31) + b"x" * 500, "do not hold the 2147483648 facets"),
        (stl(brick(), binary=False).replace(b"vertex -0.016", b"vertex nan"), "not a finite number"),
        (stl(brick(), binary=False).replace(b"vertex -0.016", b"vertex"), "without three numbers"),
        (stl(inside_out(brick())), "inside out"),
        (stl(brick().transformed(1000.0, np.zeros(3))), "millimetres"),
    ],
)
def test_an_stl_that_is_no_body_is_named(content: bytes, message: str, folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf("bad.stl"))
    (folder / "bad.stl").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        FolderSet(folder).model("x")
    assert "bad.stl" in str(caught.value)


LINK = '<link name="other"/></robot>'
BOX = '<collision><geometry><box size="1 1 1"/></geometry></collision></link>'
MANY = '<visual><geometry><mesh filename="a.obj"/></geometry></visual></link>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (urdf(mass="inf"), f"mass> is inf; it must be from {MASSES[0]:g} to {MASSES[1]:g} kg"),
        (urdf(mass="nan"), "mass nan kg; it must be greater than 0"),
        (urdf(mass="1e308"), "must be from"),
        (urdf(mass="1e-300"), "must be from"),
        (urdf(mass="0"), "greater than 0"),
        (urdf().replace('value="0.7"', 'value="nan"'), "friction> is nan"),
        (urdf().replace('value="0.7"', 'value="-5"'), f"from {FRICTIONS[0]:g} to"),
        (urdf().replace('value="0.7"', 'value="inf"'), "friction> is inf"),
        (urdf(scale="1,1,1"), "scale is '1,1,1'; it must be 1 or 3 numbers"),
        (urdf(scale="1 1"), "scale is '1 1'"),
        (urdf(scale="nan nan nan"), "scale is 'nan nan nan'"),
        (urdf(scale="1 0 1"), "is 0 along an axis"),
        (urdf(visual=ORIGIN.format("0 0", "0 0 0")), "<origin xyz> is '0 0'; it must be 3 numbers"),
        (urdf(collision=ORIGIN.format("0 0 0", "inf 0 0")), "<origin rpy> is 'inf 0 0'"),
        (urdf(collision=ORIGIN.format("0.2 0 0", "0 0 0")), "stands beside the visual mesh"),
        (urdf(inertial=ORIGIN.format("20 0 0", "0 0 0")), "centre of mass .* lies outside"),
        (urdf("a.dae"), "only OBJ and STL meshes are read, not .dae"),
        (urdf("a.glb"), "not .glb"),
        (
            urdf("package://elsewhere/a.obj"),
            "'package://elsewhere/a.obj' is not found; no folder 'elsewhere'",
        ),
        (urdf("package://../a.obj"), "is not found"),
        (urdf("file:///etc/passwd"), "is not found"),
        (urdf().replace("</robot>", LINK), "has 2 links; an object is one rigid body"),
        (urdf().replace("</link>", BOX), "a <collision> is box; it must be a <mesh>"),
        (urdf().replace("</link>", MANY), "needs one visual mesh"),
        (urdf().replace('filename="a.obj"', 'file="a.obj"'), "without a filename"),
        ('<?xml version="1.0" encoding="no-such"?><robot/>', "not a URDF"),
    ],
)
def test_a_urdf_that_is_no_body_is_named(text: str, message: str, folder: Path) -> None:
    (folder / "x.urdf").write_text(text)
    for name in ("a.dae", "a.glb"):
        (folder / name).write_text("<COLLADA/>")
    with pytest.raises(InputError, match=message) as caught:
        FolderSet(folder).model("x")
    assert str(folder) in str(caught.value)


def test_a_centre_of_mass_that_nobody_named_is_warned_of(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The engine takes the link's origin, wherever the mesh is."""
    moved = ORIGIN.format("0.2 0 0", "0 0 0")
    (folder / "x.urdf").write_text(urdf(visual=moved, collision=moved))
    assert FolderSet(folder).model("x").centre_of_mass == (0.0, 0.0, 0.0)
    assert "x.urdf: the centre of mass (0, 0, 0) lies outside" in caplog.text


def test_a_pipe_in_place_of_a_file_is_no_object(folder: Path) -> None:
    (folder / "x.urdf").write_text(urdf("pipe.obj"))
    os.mkfifo(folder / "pipe.obj")
    os.mkfifo(folder / "y.urdf")
    for name in ("x", "y"):
        with pytest.raises(InputError, match="is no file"):
            FolderSet(folder).model(name)


def test_the_content_of_objects_is_what_their_files_hold(folder: Path) -> None:
    for split in ("train", "test"):
        (folder / "pile" / split).mkdir(parents=True)
        write_obj(folder / "pile" / split / "a.obj", (brick(),))
        (folder / "pile" / split / "x.urdf").write_text(urdf())

    def content() -> str:
        library = ObjectLibrary((FolderSet(folder),))
        return library.content_hash(library.choices("train", "pile"))

    first = content()
    (folder / "pile" / "test" / "a.obj").write_text(text_of(brick().transformed(1.1, np.zeros(3))))
    (folder / "pile" / "train" / "readme.txt").write_text("of no object")
    assert content() == first
    (folder / "pile" / "train" / "a.obj").write_text(text_of(brick().transformed(1.1, np.zeros(3))))
    second = content()
    (folder / "pile" / "train" / "x.urdf").write_text(urdf(mass="0.3"))
    assert len({first, second, content()}) == 3
