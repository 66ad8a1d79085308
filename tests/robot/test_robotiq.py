"""The gripper's driver against a socket of ours that speaks its published lines, with faults."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from fake_hardware import Fingers, serving
from neugrasp.gripper import Gripper
from neugrasp.robot import robotiq
from neugrasp.robot.errors import ConnectionLost, GripperFault, MotionTimeout
from neugrasp.robot.robotiq import Robotiq

HAND = Gripper.load("robotiq_2f85")
STRAIGHT = replace(HAND, finger_arc=None)


@pytest.fixture
def fingers() -> Iterator[tuple[Fingers, int]]:
    behind = Fingers()
    with serving(behind, "127.0.0.1", 0) as port:
        yield behind, port


@pytest.mark.slow
@pytest.mark.parametrize("hand", [HAND, STRAIGHT], ids=["arc", "straight"])
def test_it_opens_and_closes_and_knows_how_far(fingers: tuple[Fingers, int], hand: Gripper):
    _, port = fingers
    with Robotiq("127.0.0.1", hand, port) as gripper:
        assert gripper.move(0.085, 20, 5) == pytest.approx(0.085)
        assert gripper.move(0.0425, 20, 5) == pytest.approx(0.0425, abs=0.0005)
        assert gripper.move(0.0, 20, 5) == 0.0
        assert not gripper.holds()


@pytest.mark.slow
def test_something_between_the_pads_is_held_and_the_old_answer_is_not_believed(fingers: tuple[Fingers, int]):
    """OBJ is asked only once the echo is that of this request."""
    behind, port = fingers
    behind.thing = 120
    with Robotiq("127.0.0.1", STRAIGHT, port) as gripper:
        gripper.move(0.085, 20, 5)
        behind.asked.clear()
        assert gripper.move(0.0, 20, 5) == pytest.approx(0.085 * 108 / 225, abs=1e-6)
        assert gripper.holds()
        first = behind.asked.index("GET OBJ")
        assert behind.asked[:first].count("GET PRE") > behind.echo_after
        assert "FOR 0" in behind.asked[0]


@pytest.mark.slow
def test_the_position_is_linear_in_the_angle_of_the_crank(fingers: tuple[Fingers, int]):
    """Halfway the pads are farther apart than half of the opening: the crank stands askew when it is open."""
    behind, port = fingers
    behind.thing = (robotiq.OPEN + robotiq.CLOSED) // 2
    assert HAND.finger_arc is not None
    middle = (HAND.finger_arc.angle(0.0) + HAND.finger_arc.angle(0.085)) / 2
    with Robotiq("127.0.0.1", HAND, port) as gripper:
        assert gripper.move(0.0, 20, 5) == pytest.approx(HAND.finger_arc.opening(middle), abs=3e-4)
    assert HAND.finger_arc.opening(middle) == pytest.approx(0.0452, abs=5e-4)


@pytest.mark.slow
def test_it_is_activated_where_it_is_not(fingers: tuple[Fingers, int]):
    behind, port = fingers
    behind.values |= {"STA": 0, "FLT": 7}
    Robotiq("127.0.0.1", HAND, port).close()
    assert [line for line in behind.asked if "ACT" in line] == ["SET ACT 0", "SET ACT 1"]


@pytest.mark.slow
def test_each_fault_is_what_it_is(fingers: tuple[Fingers, int], monkeypatch: pytest.MonkeyPatch):
    behind, port = fingers
    monkeypatch.setattr(robotiq, "TIMEOUT_S", 0.5)
    with Robotiq("127.0.0.1", HAND, port) as gripper:
        behind.never_arrives = True
        with pytest.raises(MotionTimeout, match=r"does not arrive in 0\.2 s"):
            gripper.move(0.0, 20, 0.2)
        behind.values["FLT"] = 8
        with pytest.raises(GripperFault, match="fault 8: it is too hot"):
            gripper.move(0.0, 20, 5)
        behind.lies = True
        with pytest.raises(GripperFault, match=r"answers '\?' to GET POS"):
            gripper.opening()
        behind.hangs_up = True
        with pytest.raises(ConnectionLost):
            gripper.opening()


def test_where_there_is_none_that_is_said():
    with pytest.raises(ConnectionLost, match="no gripper answers"):
        Robotiq("127.0.0.1", HAND, 9)
