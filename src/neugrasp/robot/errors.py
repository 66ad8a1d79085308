"""What stops an arm, by name: each cause is a class of its own, so that nobody has to read the text."""

from __future__ import annotations

from neugrasp.errors import NeuGraspError


class RobotError(NeuGraspError):
    """Something about the cell, not about the program. After it, nothing moves until a person has looked."""


class ConnectionLost(RobotError):
    """The controller, the gripper or the camera does not answer, or answers with old news."""


class ProtectiveStop(RobotError):
    """The controller stopped the arm: it felt a force or met a limit of its own."""


class ForceLimit(RobotError):
    """The arm pressed against something harder than the cell file allows, and was stopped."""


class EmergencyStop(RobotError):
    """Somebody pressed the button."""


class Stopped(RobotError):
    """The program was told to stop."""


class MotionTimeout(RobotError):
    """A motion took longer than it may."""


class GripperFault(RobotError):
    """The gripper reports a fault, or is not activated."""


class CameraFault(RobotError):
    """The camera gives no photo, or none that can be used."""


class Refused(RobotError):
    """A command that the layer below the network does not pass on. Nothing has moved."""

    reason = "outside the limits"
    """As a grasp that is refused is counted."""


class NotFinite(Refused):
    """NaN or infinity where a number of the arm should be."""


class LimitExceeded(Refused):
    """A joint beyond its range, or a path whose start is not where the arm is."""


class TooFast(Refused):
    """Faster, or harder accelerated, than the cell file allows."""


class TooLow(Refused):
    """The hand lower than the cell file allows: into the table."""


class OutsideZone(Refused):
    """The hand outside the zone that the cell file gives it, such as behind the robot."""


class KeptOut(Refused):
    """A part of the arm in a box that the cell file keeps it out of."""


class NoPlan(NeuGraspError):
    """A grasp that cannot be carried out from here. Nothing has moved; the next one is tried."""

    reason = "planning failed"
    """As it is counted."""


class Unreachable(NoPlan):
    """No position of the joints brings the hand there."""

    reason = "unreachable"


class InCollision(NoPlan):
    """Every way to stand there, or to come and go in a straight line, touches something."""

    reason = "collision"


class PlanningFailed(NoPlan):
    """Both ends are free, and no way between them was found in time."""


class LeftOut(NoPlan):
    """A person does not want this grasp."""

    reason = "left out by a person"


SKIPS = (Unreachable.reason, InCollision.reason, PlanningFailed.reason, Refused.reason, LeftOut.reason)
"""Why grasps are passed over, as rounds count them."""
