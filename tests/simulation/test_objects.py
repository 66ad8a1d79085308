"""Object sets: closed meshes, hollow glassware, disjoint splits, and messages for damaged folders."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from neugrasp.data.world import Body
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation import glassware, lathe
from neugrasp.simulation.meshes import Mesh, merged, read_obj, write_obj
from neugrasp.simulation.objects import KINDS, FolderSet, ObjectLibrary, PybulletSet, cache_folder
from neugrasp.simulation.physics import World

HOLLOW = ("tumbler", "bottle", "stemmed", "bowl", "jar")
NAMES = glassware.GlasswareSet().names("train", "pile")[:14]
URDF = """<robot name="cube"><link name="base">
<contact><lateral_friction value="0.7"/></contact>
<inertial><mass value="0.2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><geometry><mesh filename="{mesh}"/></geometry></visual>
<collision><geometry><mesh filename="{mesh}"/></geometry></collision>
</link></robot>"""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))


def add_cube(folder: Path, name: str, mesh: str = "") -> Path:
    """A 4 cm cube as NAME.urdf with its mesh; the mesh's path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.obj"
    write_obj(path, (lathe.box(np.full(3, 0.02)),))
    (folder / f"{name}.urdf").write_text(URDF.format(mesh=mesh or path.name))
    return path


def contains(parts: tuple[Mesh, ...], points: np.ndarray) -> np.ndarray:
    """Whether points lie in the convex hull of any part."""
    inside = np.zeros(len(points), dtype=bool)
    for part in parts:
        planes = ConvexHull(part.vertices).equations
        inside |= np.all(points @ planes[:, :3].T + planes[:, 3] <= 1e-9, axis=1)
    return inside


@pytest.mark.parametrize("name", NAMES)
def test_glassware_is_closed_centred_and_fits_the_gripper(name: str) -> None:
    model = glassware.GlasswareSet().model(name)
    surface = merged(read_obj(model.visual_mesh))
    volume, centre = surface.volume_and_centroid()
    assert surface.is_closed()
    assert volume > 0
    np.testing.assert_allclose(centre, model.centre_of_mass, atol=1e-6)
    np.testing.assert_allclose(surface.middle, 0, atol=1e-6)
    assert 0.02 <= model.mass <= 0.4
    assert surface.extents[2] <= 0.165
    # Graspable across the body, or at the rim of something open.
    assert surface.extents[:2].min() < 0.075 or name.startswith("bowl")


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith(HOLLOW)])
def test_hollow_things_are_hollow_to_the_touch_and_to_the_eye(name: str) -> None:
    solid = glassware.make(name)
    top = solid.surface.vertices[:, 2].max()
    axis = np.array([[0, 0, z] for z in np.linspace(0.75 * top, top - 0.002, 20)])
    assert not contains(solid.convex, axis).any()
    volume, _ = solid.surface.volume_and_centroid()
    filled = ConvexHull(solid.surface.vertices).volume
    assert volume < 0.55 * filled


@pytest.mark.parametrize("name", NAMES)
def test_what_is_touched_has_the_volume_of_what_is_seen(name: str) -> None:
    solid = glassware.make(name)
    touched = sum(ConvexHull(part.vertices).volume for part in solid.convex)
    seen, _ = solid.surface.volume_and_centroid()
    assert touched == pytest.approx(seen, rel=0.06)


def test_meshes_are_written_once_and_the_same_by_many_at_a_time() -> None:
    with ThreadPoolExecutor(8) as pool:
        models = list(pool.map(glassware.GlasswareSet().model, [NAMES[1]] * 16))
    assert len(set(models)) == 1
    assert sorted(path.name for path in (cache_folder() / "glassware-2").iterdir()) == [
        f"{NAMES[1]}_collision.obj",
        f"{NAMES[1]}_visual.obj",
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_train_and_test_objects_are_disjoint(kind: str, tmp_path: Path) -> None:
    for number in range(20):
        add_cube(tmp_path / "flat", f"cube{number}")
    library = ObjectLibrary.open(["folder", "pybullet", "glassware"], tmp_path / "flat")
    train, test = set(library.choices("train", kind)), set(library.choices("test", kind))
    assert not train & test
    for name in ("folder", "pybullet", "glassware"):
        assert {name} <= {chosen for chosen, _ in train} & {chosen for chosen, _ in test}


def test_single_scenes_take_the_objects_of_both_folders(tmp_path: Path) -> None:
    for part in ("packed/train", "packed/test", "pile/train", "pile/test"):
        add_cube(tmp_path / part, part.replace("/", "_"))
    objects = FolderSet(tmp_path)
    assert objects.names("test", "single") == ("packed/test/packed_test", "pile/test/pile_test")
    assert objects.names("train", "pile") == ("pile/train/pile_train",)
    model = objects.model("pile/test/pile_test")
    assert (model.mass, model.lateral_friction) == (0.2, 0.7)


@pytest.mark.parametrize("name", ["000", "500", "999"])
def test_pybullet_objects_are_shrunk_to_the_gripper(name: str) -> None:
    pytest.importorskip("pybullet_data")
    model = PybulletSet().model(name)
    surface = merged(read_obj(model.visual_mesh))
    assert surface.is_closed()
    np.testing.assert_allclose(surface.volume_and_centroid()[1], model.centre_of_mass, atol=1e-6)
    assert surface.extents[:2].min() <= 0.066
    assert surface.extents.max() <= 0.151
    assert 0.01 <= model.mass <= 0.5


def damage_hole(path: Path) -> None:
    path.write_text("\n".join(path.read_text().splitlines()[:-1]))


def damage_empty(path: Path) -> None:
    path.write_text("")


def damage_missing(path: Path) -> None:
    path.unlink()


def damage_index(path: Path) -> None:
    path.write_text(path.read_text() + "f 1 2 99\n")


def damage_nan(path: Path) -> None:
    path.write_text(path.read_text().replace("v -0.0200000", "v nan"))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (damage_hole, "not closed"),
        (damage_empty, "is empty"),
        (damage_missing, "cannot be read"),
        (damage_index, "a vertex that the file does not have"),
        (damage_nan, "not a finite number"),
    ],
)
def test_a_damaged_mesh_is_named(damage, message: str, tmp_path: Path) -> None:
    path = add_cube(tmp_path / "pile" / "train", "cube")
    damage(path)
    library = ObjectLibrary.open(["folder"], tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        library.model("folder", "pile/train/cube")
    assert "cube.obj" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not xml", "not a URDF"),
        ("<robot/>", "has no <link>"),
        (URDF.format(mesh="../../../secret.obj"), "lies outside"),
        (URDF.format(mesh="cube.obj").replace('"0.2"', '"-1"'), "greater than 0"),
        (URDF.format(mesh="cube.obj").replace('"0.2"', '"heavy"'), "not a URDF with a mass"),
    ],
)
def test_a_damaged_urdf_is_named(text: str, message: str, tmp_path: Path) -> None:
    add_cube(tmp_path / "pile" / "train", "cube")
    (tmp_path / "pile" / "train" / "cube.urdf").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        FolderSet(tmp_path).model("pile/train/cube")
    assert "cube.urdf" in str(caught.value)


def test_sets_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="choose from folder, pybullet, glassware"):
        ObjectLibrary.open(["plush"])
    with pytest.raises(InputError, match="--objects DIR"):
        ObjectLibrary.open(["folder"])
    with pytest.raises(InputError, match="no such folder"):
        ObjectLibrary.open(["folder"], tmp_path / "absent").choices("train", "pile")
    with pytest.raises(InputError, match=r"neither NAME.urdf"):
        ObjectLibrary.open(["folder"], tmp_path).choices("train", "pile")


@pytest.mark.parametrize("name", NAMES[:7])
def test_things_put_on_the_table_stay_where_they_are(name: str) -> None:
    library = ObjectLibrary.open(["glassware"])
    with World(Workspace(), library) as world:
        world.add(Body("glassware", name, 0.9, (0.15, 0.15, 0.2), (0.0, 0.0, 0.0, 1.0)))
        z = 0.2 + 0.05 - world.bottom(0) + 0.001
        world.place(0, Body("glassware", name, 0.9, (0.15, 0.15, z), (0.0, 0.0, 0.0, 1.0)))
        world.settle()
        (body,) = world.bodies()
    seen = merged(read_obj(library.model("glassware", name).visual_mesh))
    standing = 0.05 + 0.9 * seen.extents[2] / 2
    np.testing.assert_allclose(body.position, (0.15, 0.15, standing), atol=0.001)
    assert abs(body.quaternion_xyzw[3]) > 0.9999
