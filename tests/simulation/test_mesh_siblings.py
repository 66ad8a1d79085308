"""Meshes and URDFs of the kinds that once failed in silence, spelt and written otherwise."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from neugrasp.data.world import Body
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.lathe import box
from neugrasp.simulation.meshes import Mesh, merged, read_mesh
from neugrasp.simulation.objects import FolderSet, ObjectLibrary
from neugrasp.simulation.physics import World

SIZE = np.array([0.04, 0.06, 0.10])
AT = np.array([0.15, 0.15, 0.2])
BRICK = box(SIZE / 2).transformed(1.0, np.array([0.004, -0.003, 0.006]))
MIDDLE = BRICK.middle
COUNT = len(BRICK.vertices)
VERTICES = "".join(f"v {x} {y} {z}\n" for x, y, z in BRICK.vertices)
FACES = "".join(f"f {a} {b} {c}\n" for a, b, c in BRICK.faces + 1)
NEGATIVE = "".join(f"f {a} {b} {c}\n" for a, b, c in BRICK.faces - COUNT)
WHOLE = VERTICES + FACES
MARK = b"\xef\xbb\xbf"


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))


def text_stl(mesh: Mesh, name: str = "a") -> str:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in facet)
        + "endloop\nendfacet\n"
        for facet in mesh.vertices[mesh.faces]
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


def urdf(mesh: str, scale: str = "", more: str = "", inertial: str = "", inside: str = "") -> str:
    size = f' scale="{scale}"' if scale else ""
    shape = f'{more}<geometry><mesh filename="{mesh}"{size}>{inside}</mesh></geometry>'
    return (
        f'<robot name="x"><link name="a"><inertial><mass value="0.2"/></inertial>{inertial}'
        f"<visual>{shape}</visual><collision>{shape}</collision></link></robot>"
    )


def box_of(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Size and middle of what the engine has of `x.urdf`, its margins of 3 mm taken off."""
    with World(Workspace(), ObjectLibrary((FolderSet(folder),))) as world:
        world.add(Body("folder", "x", 1.0, tuple(AT), (0.0, 0.0, 0.0, 1.0)))
        low, high = map(np.array, world._client.getAABB(world._placed[0].uid))
    return high - low, (high + low) / 2 - AT


SAME_OBJ: dict[str, str | bytes] = {
    "negative numbers": VERTICES + NEGATIVE,
    "negative, two parts": f"o a\n{VERTICES}{NEGATIVE}o b\n{VERTICES}{NEGATIVE}",
    "lines and points": VERTICES + "l 1 2 3\np 1\n" + FACES,
    "curves": WHOLE + "cstype bspline\nvp 0 0 0\ncurv 0 1 1 2 3\n",
    "corners with more": VERTICES
    + "vt 0 0\nvn 0 0 1\n"
    + re.sub(r"(\d+) (\d+) (\d+)", r"\1/1/1 \2//1 \3/1", FACES),
    "colours": VERTICES.replace("\n", " 1 0 0\n") + FACES,
    "faces first": FACES + VERTICES,
    "a vertex of no face": VERTICES + "v 0.9 0.9 0.9\n" + FACES,
    "tabs, indented": "\t" + WHOLE.replace(" ", "\t").replace("\n", "\n  "),
    "Windows": WHOLE.replace("\n", "\r\n"),
    "carriage returns alone": WHOLE.replace("\n", "\r"),
    "mark of byte order": MARK + WHOLE.encode(),
    "continued lines": WHOLE.replace("f 1 ", "f 1 \\\n"),
    "other breaks in a name": "o a\x0cb\x85v 9 9 9\n" + WHOLE,
}


@pytest.mark.parametrize("name", SAME_OBJ)
@pytest.mark.parametrize("scale", ["", "1 1 1.0001"], ids=["plain", "scaled"])
def test_the_engine_has_the_same_body_however_an_obj_is_written(tmp_path: Path, name: str, scale: str):
    """It reads the user's own file where the URDF changes nothing."""
    pytest.importorskip("pybullet")
    content = SAME_OBJ[name]
    (tmp_path / "a.obj").write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "x.urdf").write_text(urdf("a.obj", scale))
    size, middle = box_of(tmp_path)
    np.testing.assert_allclose(size, SIZE, atol=0.008)
    np.testing.assert_allclose(middle, MIDDLE, atol=0.001)
    seen = merged(read_mesh(FolderSet(tmp_path).model("x").visual_mesh))
    np.testing.assert_allclose(seen.extents, SIZE, atol=1e-4)
    np.testing.assert_allclose(seen.middle, MIDDLE, atol=1e-4)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (WHOLE + f"f -{COUNT + 1} -1 -2\n", "names a vertex that the file does not have"),
        (WHOLE.upper(), "is empty"),
        (WHOLE.encode("utf-16"), "is empty"),
        (WHOLE.replace(".", ","), "not a mesh in OBJ format"),
        (WHOLE.replace("f 1 ", "f 1.0 "), "not a mesh in OBJ format"),
        (text_stl(BRICK), "is empty"),
        (b"", "is empty"),
    ],
)
def test_an_obj_that_is_none_is_named(tmp_path: Path, content: str | bytes, message: str):
    (tmp_path / "a.obj").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=f"a.obj: .*{message}"):
        read_mesh(tmp_path / "a.obj")


STL = text_stl(BRICK)


@pytest.mark.parametrize(
    "content",
    [
        STL.upper(),
        STL.replace("vertex", "Vertex").replace("solid", "Solid"),
        "\n \t" + STL,
        "\ufeff" + STL,
        STL.replace("\n", "\r"),
        text_stl(BRICK, "vertex 1 2 3"),
        STL.replace("solid a", "solid_a", 1),
    ],
    ids=["upper", "mixed", "blank", "mark", "carriage returns", "name", "joined"],
)
def test_an_stl_in_text_is_the_same_however_it_is_written(tmp_path: Path, content: str):
    (tmp_path / "a.stl").write_bytes(content.encode())
    (part,) = read_mesh(tmp_path / "a.stl")
    assert part.is_closed()
    np.testing.assert_allclose(part.extents, SIZE, atol=1e-6)


def test_the_solids_of_an_stl_are_parts_and_what_lies_between_stays_free(tmp_path: Path):
    """One convex hull about both would fill the gap."""
    pytest.importorskip("pybullet")
    walls = [box(np.array([0.005, 0.03, 0.03])).transformed(1.0, np.array([x, 0, 0])) for x in (-0.04, 0.04)]
    (tmp_path / "a.stl").write_text("".join(map(text_stl, walls)))
    (tmp_path / "x.urdf").write_text(urdf("a.stl"))
    assert len(read_mesh(tmp_path / "a.stl")) == 2
    with World(Workspace(), ObjectLibrary((FolderSet(tmp_path),))) as world:
        world.add(Body("folder", "x", 1.0, (0.15, 0.15, 0.2), (0.0, 0.0, 0.0, 1.0)))
        (between,) = world._client.rayTest([0.15, 0.15, 0.4], [0.15, 0.15, 0.15])
        (wall,) = world._client.rayTest([0.19, 0.15, 0.4], [0.19, 0.15, 0.15])
    assert between[0] == -1
    assert wall[0] != -1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (STL[: STL.index("facet", len(STL) // 2 + 80)], "cut off"),
        (STL.replace("endsolid a", ""), "cut off"),
        (STL.replace("endloop", "vertex 0 0 0\nendloop", 1), "without three corners"),
        (STL.replace("\n", " "), "cut off"),
        (STL.replace(".", ","), "not a mesh in STL format"),
        (WHOLE, "not a mesh in STL format"),
        ("solid a\nendsolid a\n", "is empty"),
    ],
    ids=["half", "no end", "four corners", "one line", "commas", "OBJ", "nothing"],
)
def test_an_stl_that_is_cut_off_or_none_is_named(tmp_path: Path, content: str, message: str):
    (tmp_path / "a.stl").write_text(content)
    with pytest.raises(InputError, match=f"a.stl: .*{message}"):
        read_mesh(tmp_path / "a.stl")


@pytest.mark.parametrize("scale", ["-1 1 1", "-1 -1 1", "-1 -1 -1", "-1", "1\t1\n-1"])
def test_mirrored_along_any_axes_a_body_is_right_side_out(tmp_path: Path, scale: str):
    (tmp_path / "a.obj").write_text(VERTICES + NEGATIVE)
    (tmp_path / "x.urdf").write_text(urdf("a.obj", scale))
    mesh = merged(read_mesh(FolderSet(tmp_path).model("x").visual_mesh))
    assert mesh.volume_and_centroid()[0] == pytest.approx(np.prod(SIZE))
    signs = np.array([float(word) for word in scale.split()]) * np.ones(3)
    np.testing.assert_allclose(mesh.middle, MIDDLE * signs, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            urdf("a.obj", more='<origin xyz="0 0 0" rpy="90 0 0"/>'),
            "'90 0 0', more than a whole turn",
        ),
        (urdf("a.obj", more='<origin rpy="0 0 -180"/>'), "it must be in radians"),
        (urdf("a.obj", more='<Origin xyz="0 0 0.02"/>'), "<Origin> in a <visual> is not of URDF"),
        (urdf("a.obj", more="<pose>0 0 0.02 0 0 0</pose>"), "<pose> in a <visual> is not of URDF"),
        (urdf("a.obj", more='<origin xyz="0 0 0"/><origin xyz="0.02 0 0"/>'), "has two <origin>"),
        (urdf("a.obj", more='<origin quat_xyzw="0.7 0 0 0.7"/>'), "quat_xyzw=... of a <origin>"),
        (urdf("a.obj", more='<origin XYZ="0 0 0.1"/>'), "XYZ=... of a <origin> is not of URDF"),
        (urdf("a.obj", inside="<scale>0.5 0.5 0.5</scale>"), "<scale> in a <mesh> is not of URDF"),
        (urdf("a.obj").replace("<mesh ", '<mesh Scale="0.5" '), "Scale=... of a <mesh>"),
        (urdf("a.obj").replace("<mesh ", '<mesh unit="mm" '), "unit=... of a <mesh>"),
        (urdf("a.obj").replace("<geometry>", '<geometry scale="0.5">'), "scale=... of a <geometry>"),
        (urdf("a.obj", inertial='<inertial><mass value="9"/></inertial>'), "has two <inertial>"),
        (urdf("a.obj").replace("<mass", '<mass value="3"/><mass'), "has two <mass>"),
        (urdf("a.obj", scale="0.001mm"), "scale is '0.001mm'"),
        (urdf("a.obj", scale="${s} ${s} ${s}"), "it must be 1 or 3 numbers"),
        (urdf("A.obj"), "A.obj: cannot be read"),
        (urdf("../../a.obj"), "lies outside"),
        (urdf("a.obj").replace("<robot", '<robot xmlns="http://sdformat.org"'), "has no <link>"),
        ("", "not a URDF"),
    ],
)
def test_what_the_engine_would_leave_out_of_a_urdf_is_refused(tmp_path: Path, text: str, message: str):
    (tmp_path / "a.obj").write_text(WHOLE)
    (tmp_path / "x.urdf").write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        FolderSet(tmp_path).model("x")


@pytest.mark.parametrize("name", ["Ä ö.obj", "a b.obj", "../x/a.obj", "sub\\a.obj", "A.Obj"])
def test_names_of_meshes_may_be_in_any_language(tmp_path: Path, name: str):
    folder = tmp_path / "x"
    (folder / "sub").mkdir(parents=True)
    (folder / name.replace("\\", "/")).resolve().write_text(WHOLE)
    (folder / "x.urdf").write_text(urdf(name), encoding="utf-8")
    np.testing.assert_allclose(merged(read_mesh(FolderSet(folder).model("x").visual_mesh)).extents, SIZE)
