"""The node and a rosbridge: what it says at first, what it answers, and that it comes back."""

from __future__ import annotations

import base64
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

pytest.importorskip("websockets", minversion="15")

from held_detector import FlatTable
from neugrasp import cli
from neugrasp.errors import InputError
from neugrasp.exporters.ros import link_from_tcp, pose_of
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.ros.messages import Transforms, cloud_of, grasps_of, intrinsics_of, photo_of
from neugrasp.ros.node import Node
from neugrasp.ros.parameters import Parameters, read_parameters

from .conftest import Peer, Show, info, raw, tree
from .definitions import check

ACTION = {"action": "/neugrasp/plan_grasps", "action_type": "grasping_msgs/action/GraspPlanning"}


@pytest.fixture
def ready(peer: Peer, node: Node, show: Show) -> Peer:
    """With backgrounds taken, and objects on the table."""
    peer.wait("advertise", topic="/neugrasp/surface")
    show("background")
    peer.say(op="call_service", id="b", service="/neugrasp/take_backgrounds", args={})
    answer = peer.wait("service_response", id="b")
    assert answer["values"]["success"], answer
    show("image")
    return peer


def test_it_says_what_it_offers_and_what_it_listens_to(peer: Peer, node: Node, given: Parameters):
    peer.wait("advertise", topic="/neugrasp/surface")
    offered = {(m["op"], m.get("service") or m.get("action") or m.get("topic")): m["type"] for m in peer.said}
    assert offered["advertise_action", "/neugrasp/plan_grasps"] == "grasping_msgs/action/GraspPlanning"
    assert offered["advertise_service", "/neugrasp/plan"] == "std_srvs/srv/Trigger"
    assert offered["advertise", "/neugrasp/grasps"] == "grasping_msgs/msg/GraspableObject"
    assert offered["subscribe", "/camera0/image"] == "sensor_msgs/msg/Image"
    assert offered["subscribe", "/camera3/image/compressed"] == "sensor_msgs/msg/CompressedImage"
    assert offered["subscribe", "/tf_static"] == "tf2_msgs/msg/TFMessage"
    check([m for m in peer.said if m["op"] == "subscribe"], "subscribe[]")


def test_the_action_gives_feedback_then_grasps_of_the_parent_link(
    ready: Peer, views: Views, given: Parameters
):
    ready.say(op="send_action_goal", id="g1", args={"object": {}, "group_name": ""}, feedback=True, **ACTION)
    result = ready.wait("action_result", id="g1")
    feedback = ready.wait("action_feedback", id="g1")
    assert ready.said.index(feedback) < ready.said.index(result)
    assert (result["status"], result["result"]) == (4, True)
    assert feedback["values"] == result["values"]
    check(result["values"]["grasps"], "moveit_msgs/Grasp[]")
    expected, gripper = FlatTable().detect(views).grasps, Gripper.load("panda")
    for message, grasp in zip(result["values"]["grasps"], expected, strict=True):
        tcp = pose_of(message["grasp_pose"]) @ link_from_tcp(gripper, "hand", 0.0)
        np.testing.assert_allclose(tcp, grasp.pose, atol=1e-6)
        # The hand's frame lies behind the TCP, against the approach.
        behind = pose_of(message["grasp_pose"])[:3, 3] - grasp.position
        np.testing.assert_allclose(behind, -gripper.tcp_height * grasp.approach, atol=1e-6)
        assert message["grasp_quality"] == grasp.score
        assert message["grasp_pose"]["header"]["frame_id"] == "base"
        assert message["grasp_posture"]["points"][0]["positions"] == [grasp.width / 2] * 2


def test_the_service_publishes_grasps_and_surface(ready: Peer, views: Views):
    ready.say(op="call_service", id="p", service="/neugrasp/plan", args={})
    values = ready.wait("service_response", id="p")["values"]
    check(values, "std_srvs/Trigger_Response")
    assert values["success"]
    assert values["message"].startswith("2 grasps")
    thing = ready.wait("publish", topic="/neugrasp/grasps")["msg"]
    check(thing, "grasping_msgs/GraspableObject")
    assert [grasp["id"] for grasp in thing["grasps"]] == ["grasp_0", "grasp_1"]
    cloud = ready.wait("publish", topic="/neugrasp/surface")["msg"]
    check(cloud, "sensor_msgs/PointCloud2")
    points = np.frombuffer(base64.b64decode(cloud["data"]), "<f4").reshape(-1, 3)
    np.testing.assert_allclose(points, FlatTable().detect(views).surface().vertices, atol=1e-5)


def test_a_goal_that_is_cancelled_gets_no_grasps(ready: Peer):
    ready.say(op="cancel_action_goal", id="g2", action=ACTION["action"])
    ready.say(op="send_action_goal", id="g2", args={}, **ACTION)
    result = ready.wait("action_result", id="g2")
    assert (result["status"], result["values"], result["result"]) == (5, {"grasps": []}, False)


@pytest.mark.slow
def test_it_comes_back_and_offers_everything_again(ready: Peer, show: Show, node: Node):
    before = len(ready.said)
    ready.hang_up()
    ready.wait("advertise", count=2, topic="/neugrasp/surface")
    again = [m for m in ready.said[before:] if m["op"].startswith(("adv", "sub"))]
    assert again == [m for m in ready.said[:before] if m["op"].startswith(("adv", "sub"))]
    assert node.bridge.connections == 2
    show("image", with_tf=False)
    ready.say(op="send_action_goal", id="g3", args={}, **ACTION)
    assert ready.wait("action_result", id="g3")["status"] == 4


def test_what_is_missing_is_said(peer: Peer, node: Node, show: Show, given: Parameters, views: Views):
    def said(name: str) -> str:
        peer.say(op="call_service", id=name, service="/neugrasp/plan", args={})
        values = peer.wait("service_response", id=name)["values"]
        assert not values["success"]
        return str(values["message"])

    peer.wait("advertise", topic="/neugrasp/surface")
    assert "call /neugrasp/take_backgrounds once" in said("a")
    show("background", with_tf=False)
    peer.say(op="call_service", id="b", service="/neugrasp/take_backgrounds", args={})
    peer.wait("service_response", id="b")
    assert "/tf does not join base and optical0" in said("c")
    peer.say(op="publish", topic="/tf", msg=tree(views))
    peer.say(op="publish", topic="/camera0/image", msg={"data": "?"})
    assert "/camera0/image" in said("d")
    peer.say(op="send_action_goal", id="e", args={}, **ACTION)
    assert peer.wait("action_result", id="e")["status"] == 6


@pytest.mark.slow
def test_old_photos_are_not_grasped_by(peer: Peer, given: Parameters, show: Show, node: Node):
    object.__setattr__(node, "given", replace(given, oldest_s=0.2))
    peer.wait("advertise", topic="/neugrasp/surface")
    show("background")
    time.sleep(0.5)
    peer.say(op="call_service", id="o", service="/neugrasp/take_backgrounds", args={})
    assert "s old; at most 0.2" in peer.wait("service_response", id="o")["values"]["message"]


def test_messages_that_are_none_are_passed_over(ready: Peer):
    deep = '{"op": ' + 5000 * "[" + 5000 * "]" + "}"
    twice = '{"op": "publish", "op": "call_service", "service": "/neugrasp/plan"}'
    for text in ("{", "[]", '{"op": 1}', '{"op": "publish"}', '{"op": "publish", "topic": "/tf", "msg": {}}'):
        ready._connection.send(text)
    endless = '{"op": "publish", "topic": "/tf", "msg": {"transforms": 1e999}}'
    for text in (deep, twice, endless, '{"op": [1]}'):
        ready._connection.send(text)
    ready.say(op="call_service", id="q", service="/neugrasp/plan", args={})
    assert ready.wait("service_response", id="q")["values"]["success"]


def test_every_caller_gets_an_answer(ready: Peer, node: Node, monkeypatch: pytest.MonkeyPatch):
    def broken(views: Views) -> None:
        raise RuntimeError("CUDA error")

    monkeypatch.setattr(node, "_detect", broken)
    ready.say(op="call_service", id="x", service="/neugrasp/plan", args={})
    values = ready.wait("service_response", id="x")["values"]
    assert not values["success"]
    assert "mistake of the node (RuntimeError)" in values["message"]
    for goal in ("g", 7, ["g"]):
        ready.say(op="send_action_goal", id=goal, args={}, **ACTION)
        assert ready.wait("action_result", id=goal)["status"] == 6


def test_a_goal_with_a_number_is_cancelled_like_others(ready: Peer):
    ready.say(op="cancel_action_goal", id=8, action=ACTION["action"])
    ready.say(op="send_action_goal", id=8, args={}, **ACTION)
    assert ready.wait("action_result", id=8)["status"] == 5


def test_another_service_does_not_take_photos_of_the_empty_table(ready: Peer, given: Parameters):
    before = (given.backgrounds / "0.png").stat().st_mtime_ns
    for number, name in enumerate(("/neugrasp//plan", "/neugrasp/plan/", "/other", "")):
        ready.say(op="call_service", id=number, service=name, args={})
        values = ready.wait("service_response", id=number)["values"]
        assert (values["success"], values["message"]) == (False, f"there is no service {name!r}")
    assert (given.backgrounds / "0.png").stat().st_mtime_ns == before


def test_backgrounds_of_another_size_are_told(ready: Peer, given: Parameters):
    file = given.backgrounds / "0.png"
    Picture.new("RGB", (100, 80)).save(file)
    ready.say(op="call_service", id="s", service="/neugrasp/plan", args={})
    message = ready.wait("service_response", id="s")["values"]["message"]
    assert f"{file}: 100 x 80 pixels, /camera0/image has" in message
    assert "take_backgrounds again" in message


def test_a_photo_of_another_frame_than_given_is_told(ready: Peer, caplog: pytest.LogCaptureFixture):
    ready.say(op="call_service", id="f", service="/neugrasp/plan", args={})
    ready.wait("service_response", id="f")
    assert "/camera0/image: says that its frame is optical, not optical0 as given" in caplog.text


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "mono8"])
def test_raw_photos_come_as_they_were(encoding: str, rng: np.random.Generator):
    photo = rng.integers(0, 256, (40, 50, 3), dtype=np.uint8)
    expected = np.repeat(photo[..., :1], 3, axis=2) if encoding == "mono8" else photo
    np.testing.assert_array_equal(photo_of(raw(photo, encoding), "/image", False), expected)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"encoding": "bayer_rggb8"}, "encoding is 'bayer_rggb8'"),
        ({"step": 3}, "step is 3"),
        ({"data": "AAAA"}, "data has 3 bytes"),
        ({"data": "%"}, "no base64"),
        ({"data": [1, 256]}, "data is no list of bytes"),
        ({"data": [1, -1]}, "data is no list of bytes"),
        ({"data": [1.5, True, "a"]}, "data is no list of bytes"),
        ({"data": None}, "data is None"),
        ({"height": 10**9}, "height is"),
    ],
)
def test_raw_photos_that_are_none(change: dict, words: str):
    with pytest.raises(InputError, match=words):
        photo_of({**raw(np.zeros((40, 50, 3), np.uint8)), **change}, "/image", False)


@pytest.mark.parametrize(
    ("change", "is_rectified", "words"),
    [
        ({}, False, "distorted"),
        ({"d": [None]}, False, "d is .None.; it must be a list of numbers"),
        ({"d": ["0"]}, False, "it must be a list of numbers"),
        ({"d": [float("nan")]}, False, "distorted"),
        ({"p": 12 * [0.0]}, True, "camera is not calibrated"),
        ({"p": [100, 0, 20, -5, 0, 100, 20, 0, 0, 0, 1, 0]}, True, "right one of a stereo pair"),
        ({"binning_x": 2}, True, "whole size"),
        ({"width": 7}, True, "the photo has 50 x 40"),
        ({"roi": {"x_offset": 8, "y_offset": 0}}, True, "whole sensor"),
    ],
)
def test_cameras_that_are_no_pinholes(change: dict, is_rectified: bool, words: str):
    photo = np.zeros((40, 50, 3), np.uint8)
    matrix = np.array([[60.0, 0, 25], [0, 60, 20], [0, 0, 1]])
    with pytest.raises(InputError, match=words):
        intrinsics_of({**info(matrix, photo), **change}, "/info", photo, is_rectified)
    np.testing.assert_array_equal(intrinsics_of(info(matrix, photo), "/info", photo, True), matrix)


def test_transforms_are_joined_through_the_tree(views: Views):
    transforms = Transforms()
    transforms.take(tree(views))
    for i, view in enumerate(views.frames):
        np.testing.assert_allclose(
            transforms.pose("base", f"optical{i}"), view.camera.world_from_camera, atol=1e-9
        )
    between = transforms.pose("optical0", "optical1")
    first, second = (view.camera.world_from_camera for view in views.frames[:2])
    np.testing.assert_allclose(first @ between, second, atol=1e-9)
    assert transforms.pose("base", "elsewhere") is None


@pytest.mark.parametrize("link", ["tcp", "hand", "panda_link8"])
def test_each_link_leads_back_to_the_grasp(link: str, views: Views, given: Parameters):
    gripper, grasps = Gripper.load("panda"), FlatTable().detect(views).grasps
    for message, grasp in zip(grasps_of(grasps, gripper, replace(given, link=link)), grasps, strict=True):
        np.testing.assert_allclose(
            pose_of(message["grasp_pose"]) @ link_from_tcp(gripper, link, 0.0), grasp.pose, atol=1e-6
        )
        direction = message["pre_grasp_approach"]["direction"]["vector"]
        np.testing.assert_allclose(list(direction.values()), grasp.approach, atol=1e-9)


def test_parameters_are_written_to_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    file = tmp_path / "node.json"
    assert cli.main(["ros", str(file), "--write"]) == 0
    given = read_parameters(file)
    assert (len(given.cameras), given.cameras[3].is_compressed) == (4, True)
    assert cli.main(["ros", str(file), "--write"]) == 2
    content = json.loads(file.read_text())
    for change, words in (
        ({"bridge": "http://x"}, "bridge is 'http://x'; it must be as ws://127.0.0.1:9090"),
        ({"bridge": "ws://"}, "bridge is 'ws://'"),
        ({"bridge": "ws://host:port"}, "bridge is 'ws://host:port'"),
        ({"namespace": "/neugrasp/"}, "namespace is '/neugrasp/'; it must be as /neugrasp"),
        ({"namespace": ""}, "namespace is ''"),
        ({"finger_joints": []}, "it must be a list of names"),
        ({"finger_joints": ["a", 1]}, "it must be a list of names"),
        ({"cameras": 2 * content["cameras"][:1]}, "name one topic of photos twice"),
        ({"colour": 1}, "colour is unknown"),
        ({"link": "wrist"}, "link is 'wrist'"),
        ({"cameras": []}, "cameras has 0"),
    ):
        file.write_text(json.dumps({**content, **change}))
        assert cli.main(["ros", str(file)]) == 2
        assert words in capsys.readouterr().err


def test_an_empty_cloud_is_one(given: Parameters):
    check(cloud_of(np.empty((0, 3)), "base"), "sensor_msgs/PointCloud2")
