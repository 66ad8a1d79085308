"""Grasps survive the way into another convention and back, and lie in it where that program expects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neugrasp import cli
from neugrasp.detection.files import read_grasp_list, write_grasps
from neugrasp.errors import InputError
from neugrasp.exporters import graspnet, ros, ur, vgn
from neugrasp.geometry.pose import apply, from_quaternion, inverse, rigid
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

GRIPPERS = [Gripper.load("panda"), Gripper.load("robotiq_2f85")]
LINKS: tuple[ros.Link, ...] = ("tcp", "hand")

coordinates = st.floats(-10, 10)
grasps = st.lists(
    st.builds(
        lambda q, p, width, score: Grasp(from_quaternion(q, p), width, score),
        st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: float(np.linalg.norm(q)) > 0.1),
        st.tuples(coordinates, coordinates, coordinates),
        st.floats(1e-4, 0.2),
        st.floats(0, 1),
    ),
    max_size=4,
)


def same(one: list[Grasp], other: list[Grasp]) -> None:
    assert len(one) == len(other)
    for mine, yours in zip(one, other, strict=True):
        np.testing.assert_allclose(mine.pose, yours.pose, atol=1e-9)
        assert (mine.width, mine.score) == (yours.width, yours.score)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(grasps, st.sampled_from(GRIPPERS))
def test_decoding_undoes_encoding(found: list[Grasp], gripper: Gripper):
    same(graspnet.decode(graspnet.encode(found, gripper), gripper), found)
    same(vgn.decode(vgn.encode(found, gripper), gripper), found)
    for link in LINKS:
        stamp = ros.Stamp("base_link", link)
        same(ros.decode(ros.encode(found, gripper, stamp), gripper, stamp), found)
        for row, grasp in zip(ur.encode(found, gripper, link), found, strict=True):
            shift = ros.link_from_tcp(gripper, link, grasp.width)
            way = {"pregrasp": grasp.pregrasp, "grasp": grasp.pose, "retreat": grasp.retreat}
            for key, pose in way.items():
                np.testing.assert_allclose(ur.pose_of(row[key]) @ shift, pose, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(grasps, st.sampled_from(GRIPPERS))
def test_the_files_hold_the_same(
    tmp_path_factory: pytest.TempPathFactory, found: list[Grasp], gripper: Gripper
):
    folder = tmp_path_factory.mktemp("grasps")
    graspnet.write(folder / "a.npy", found, gripper)
    same(graspnet.read(folder / "a.npy", gripper), found)
    vgn.write(folder / "a.csv", found, gripper)
    same(vgn.read(folder / "a.csv", gripper), found)
    for link in LINKS:
        ros.write(folder / "a.json", found, gripper, ros.Stamp("map", link))
        same(ros.read(folder / "a.json", gripper), found)
        ur.write(folder / "b.json", found, gripper, link)
        same(ur.read(folder / "b.json", gripper), found)


GRASP = Grasp(from_quaternion([0.2, 0.9, -0.3, 0.1], (0.4, -0.1, 0.3)), width=0.05, score=0.9)


@pytest.mark.parametrize("gripper", GRIPPERS, ids=lambda gripper: gripper.name)
def test_graspnet_draws_its_gripper_where_ours_is(gripper: Gripper):
    """graspnetAPI's picture: fingers from 2 cm before the origin to `depth` beyond it along x, at +-width / 2
    in y. Ours: the tips of the wireframe, and its fingers of `finger_depth`."""
    (row,) = graspnet.encode([GRASP], gripper)
    pose = rigid(row[4:13].reshape(3, 3), row[13:16])
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    y = row[1] / 2
    tips = apply(pose, [(row[3], y, 0), (row[3], -y, 0)])
    ours = apply(GRASP.pose, gripper.wireframe(GRASP.width)[1:3, 1])
    np.testing.assert_allclose(tips, ours, atol=1e-9)
    palm = apply(pose, (-0.02, 0, 0))
    np.testing.assert_allclose(tips.mean(axis=0) - palm, gripper.finger_depth * GRASP.approach, atol=1e-9)
    assert 0.01 <= row[3] <= 0.04
    assert row[16] == -1


def test_any_depth_of_graspnet_leads_to_the_same_tips():
    gripper = GRIPPERS[0]
    (row,) = graspnet.encode([GRASP], gripper)
    nearer = row.copy()
    nearer[3] += 0.013
    nearer[13:16] -= 0.013 * GRASP.approach
    same(graspnet.decode(nearer[None], gripper), [GRASP])


def test_vgn_and_the_labels_agree_on_the_grasp_point():
    """VGN's TCP is 0.022 m beyond the centre of mass of the Panda's hand: 0.062 m from its flange."""
    gripper = GRIPPERS[0]
    (row,) = vgn.encode([GRASP], gripper)
    hand_from_grasp = inverse(GRASP.advanced(-gripper.tcp_height).pose)
    np.testing.assert_allclose(apply(hand_from_grasp, row[4:7]), (0, 0, 0.062), atol=1e-9)
    np.testing.assert_allclose(from_quaternion(row[:4])[:3, :3], GRASP.pose[:3, :3], atol=1e-9)


def test_ros_gets_a_pose_stamped_of_the_link():
    gripper = GRIPPERS[0]
    (tcp,) = ros.encode([GRASP], gripper, ros.Stamp("base_link"))
    (hand,) = ros.encode([GRASP], gripper, ros.Stamp("base_link", "hand"))
    assert set(tcp) == {"id", "grasp_pose", "pre_grasp_pose", "retreat_pose", "grasp_quality", "width"}
    np.testing.assert_allclose(ros.pose_of(tcp["pre_grasp_pose"]), GRASP.pregrasp, atol=1e-9)
    np.testing.assert_allclose(ros.pose_of(tcp["retreat_pose"]), GRASP.retreat, atol=1e-9)
    pose = tcp["grasp_pose"]
    assert pose["header"] == {"frame_id": "base_link"}
    assert list(pose["pose"]["position"].values()) == pytest.approx([0.4, -0.1, 0.3])
    # The Panda's TCP is 0.1034 m beyond panda_hand.
    between = inverse(ros.pose_of(hand["grasp_pose"])) @ ros.pose_of(pose)
    np.testing.assert_allclose(between, rigid(translation=(0, 0, 0.1034)), atol=1e-9)


def test_universal_robots_get_a_rotation_vector_in_radians():
    """Straight down with the fingers along y is half a turn about x."""
    down = Grasp(rigid(np.diag([1.0, -1.0, -1.0]), (0.4, -0.1, 0.3)), 0.05, 0.9)
    (row,) = ur.encode([down], GRIPPERS[0], "tcp")
    np.testing.assert_allclose(np.abs(row["grasp"]), (0.4, 0.1, 0.3, np.pi, 0, 0), atol=1e-9)
    np.testing.assert_allclose(row["pregrasp"][:3], (0.4, -0.1, 0.35), atol=1e-9)
    np.testing.assert_allclose(row["retreat"][:3], (0.4, -0.1, 0.40), atol=1e-9)
    (row,) = ur.encode([down], GRIPPERS[0], "hand")
    np.testing.assert_allclose(row["grasp"][:3], (0.4, -0.1, 0.3 + 0.1034), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grasp": [0.1, 0.2, 0.3, 0, 180, 0]}, "longer than a whole turn; radians are wanted"),
        ({"grasp": [0.1, 0.2, 0.3]}, r"grasps\[0\]\.grasp is not \[x, y, z, rx, ry, rz\]"),
        ({"width": -1}, "width"),
    ],
)
def test_poses_of_universal_robots_that_are_none(tmp_path: Path, change: dict[str, object], message: str):
    ur.write(tmp_path / "a.json", [GRASP], GRIPPERS[0], "tcp")
    content = json.loads((tmp_path / "a.json").read_text())
    content["grasps"][0] |= change
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        ur.read(tmp_path / "a.json", GRIPPERS[0])


def test_the_way_of_the_hand_is_the_same_wherever_the_world_lies(tmp_path: Path):
    """From above and from the side, in a world whose z is not up: through grasps.json and every export."""
    world = from_quaternion([0.3, -0.5, 0.2, 0.7], (2, -1, 0.5))
    side = Grasp(rigid([[0, 0, 1], [1, 0, 0], [0, 1, 0]], (0.15, 0.1, 0.1)), 0.05, 0.9)
    above = Grasp(rigid(np.diag([1.0, -1.0, -1.0]), (0.1, 0.1, 0.1)), 0.05, 0.8)
    for grasp in (side, above):
        np.testing.assert_allclose(grasp.retreat[:3, 3] - grasp.position, (0, 0, 0.1), atol=1e-12)
        np.testing.assert_allclose(grasp.position - grasp.pregrasp[:3, 3], 0.05 * grasp.approach, atol=1e-12)
    file = tmp_path / "grasps.json"
    write_grasps(file, [side.moved(world), above.moved(world)], {"gripper": "panda"})
    written = json.loads(file.read_text())
    np.testing.assert_allclose(written["up"], world[:3, 2], atol=1e-9)
    found = read_grasp_list(file)
    assert found.knows_up
    for here, there, entry in zip((side, above), found.grasps, written["grasps"], strict=True):
        np.testing.assert_allclose(there.retreat, world @ here.retreat, atol=1e-9)
        np.testing.assert_allclose(there.pregrasp, world @ here.pregrasp, atol=1e-9)
        np.testing.assert_allclose(entry["retreat_position"], there.retreat[:3, 3], atol=1e-9)
        np.testing.assert_allclose(entry["pregrasp_position"], there.pregrasp[:3, 3], atol=1e-9)
    assert cli.main(["export", str(file), "--format", "ur"]) == 0
    exported = json.loads((tmp_path / "grasps_ur.json").read_text())["grasps"]
    for here, entry in zip((side, above), exported, strict=True):
        np.testing.assert_allclose(ur.pose_of(entry["retreat"]), world @ here.retreat, atol=1e-9)


def test_an_older_prediction_does_not_say_which_way_is_up(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    file = tmp_path / "grasps.json"
    write_grasps(file, [GRASP], {"gripper": "panda"})
    content = json.loads(file.read_text())
    del content["up"]
    file.write_text(json.dumps(content))
    for name, is_told in (("ros", True), ("ur", True), ("vgn", False)):
        caplog.clear()
        assert cli.main(["export", str(file), "--format", name]) == 0
        assert ("does not say which way is up" in caplog.text) is is_told
    file.write_text(json.dumps({**content, "up": [0, 0, 2]}))
    assert cli.main(["export", str(file)]) == 2


def test_the_arm_s_last_link_stands_as_franka_mounts_the_hand_on_it():
    """franka_description: panda_hand_joint is the fixed joint from panda_link8 with rpy 0 0 -pi/4."""
    panda, stamp = GRIPPERS[0], ros.Stamp("base_link", "panda_link8")
    (hand,) = ros.encode([GRASP], panda, ros.Stamp("base_link", "hand"))
    (link8,) = ros.encode([GRASP], panda, stamp)
    between = inverse(ros.pose_of(link8["grasp_pose"])) @ ros.pose_of(hand["grasp_pose"])
    turn = from_quaternion([0, 0, np.sin(-np.pi / 8), np.cos(np.pi / 8)])
    np.testing.assert_allclose(between, turn, atol=1e-9)
    same(ros.decode([link8], panda, stamp), [GRASP])
    with pytest.raises(InputError, match="is of the Panda; for robotiq_2f85 give hand or tcp"):
        ros.encode([GRASP], GRIPPERS[1], stamp)


@pytest.fixture
def grasps_json(tmp_path: Path) -> Path:
    found = [GRASP, Grasp(GRASP.pose, 0.03, 0.95)]
    write_grasps(tmp_path / "grasps.json", found, {"gripper": "panda"})
    return tmp_path / "grasps.json"


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ([], "grasps_ros.json"),
        (["--format", "ros", "--out", "OUT/r.yaml", "--link", "hand", "--frame-id", "base"], "r.yaml"),
        (["--link", "panda_link8"], "grasps_ros.json"),
        (["--format", "graspnet", "--out", "OUT/new/g.npy"], "new/g.npy"),
        (["--format", "vgn", "--gripper", "robotiq_2f85"], "grasps_vgn.csv"),
    ],
)
def test_the_program_writes_the_file(
    grasps_json: Path, tmp_path: Path, arguments: list[str], name: str, capsys: pytest.CaptureFixture[str]
):
    arguments = [word.replace("OUT", str(tmp_path)) for word in arguments]
    assert cli.main(["export", str(grasps_json), *arguments]) == 0
    assert f"2 grasps in {tmp_path / name}" in capsys.readouterr().out
    file = tmp_path / name
    gripper = GRIPPERS["robotiq_2f85" in arguments]
    read = {".npy": graspnet.read, ".csv": vgn.read}.get(file.suffix, ros.read)
    same(read(file, gripper), [Grasp(GRASP.pose, 0.03, 0.95), GRASP])
    if file.suffix == ".yaml":
        assert json.loads(file.read_text())["grasps"][0]["grasp_pose"]["header"] == {"frame_id": "base"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "vgn", "--out", "a.npy"], "a.npy: vgn grasps are written as .csv"),
        (["--format", "vgn", "--link", "hand"], "--link is for --format ros"),
        (["--format", "graspnet", "--frame-id", "map"], "--frame-id is for --format ros"),
        (["--gripper", "hook"], "unknown gripper 'hook'"),
        (["--gripper", "Panda"], "unknown gripper 'Panda'"),
        (["--gripper", "robotiq_2f85", "--link", "panda_link8"], "is of the Panda"),
        (["--format", "ur", "--link", "panda_link8"], "is of the Panda"),
    ],
)
def test_a_mistake_ends_with_2(
    grasps_json: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["export", str(grasps_json), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert [file.name for file in grasps_json.parent.iterdir()] == ["grasps.json"]


def test_grasps_of_an_unknown_gripper_are_not_guessed_at(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "grasps.json"
    for origin, message in (({}, "names no gripper"), ({"gripper": "hook"}, "'hook', which is not bundled")):
        write_grasps(file, [GRASP], origin)
        assert cli.main(["export", str(file), "--format", "vgn"]) == 2
        assert message in capsys.readouterr().err
    assert cli.main(["export", str(file), "--format", "vgn", "--gripper", "robotiq_2f85"]) == 0
    same(vgn.read(tmp_path / "grasps_vgn.csv", GRIPPERS[1]), [GRASP])


def test_other_files_are_refused(tmp_path: Path):
    gripper = GRIPPERS[0]
    np.save(tmp_path / "a.npy", np.zeros((2, 16)))
    (tmp_path / "b.npy").write_text("no array")
    (tmp_path / "a.csv").write_text("x,y,z\n1,2,3\n")
    (tmp_path / "a.json").write_text('{"format": "neugrasp-grasps"}')
    for read, name in (
        (graspnet.read, "a.npy"),
        (graspnet.read, "b.npy"),
        (graspnet.read, "none.npy"),
        (vgn.read, "a.csv"),
        (vgn.read, "none.csv"),
        (ros.read, "a.json"),
        (ros.read, "none.json"),
    ):
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            read(tmp_path / name, gripper)
