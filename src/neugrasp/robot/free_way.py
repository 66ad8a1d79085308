"""Ways between two positions of the joints that touch nothing: the only file that imports OMPL."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from neugrasp.errors import require
from neugrasp.geometry.pose import Array
from neugrasp.robot.arm_model import JOINTS, ArmModel
from neugrasp.robot.errors import PlanningFailed

STEP = 0.04
"""Radians between two positions that are checked, of the joint that turns most."""
RANGE = 0.6
"""Radians by which a tree grows at once."""
CHECKS = 4000
"""Positions checked before a search is given up: the same answer every time, on any machine."""
SHORTCUTS = 60
"""Attempts to leave out corners."""

IsFree = Callable[[Array], bool]


def free_way(start: Array, goal: Array, model: ArmModel, is_free: IsFree, timeout_s: float) -> list[Array]:
    """Legs (m, 6) of a way from `start` to `goal`, straight in the space of the joints, each densely sampled.

    Straight where that is free, else by two trees that grow towards each other (RRT-Connect), with corners
    left out where that is free. The same question has the same answer. Raises `PlanningFailed`.
    """
    if _is_leg_free(start, goal, is_free):
        return [leg(start, goal)]
    corners = _shortened(_connected(start, goal, model, is_free, timeout_s), is_free)
    return [leg(a, b) for a, b in pairwise(corners)]


def leg(start: Array, goal: Array) -> Array:
    """The straight way (m, 6), `STEP` or less between two positions."""
    count = max(2, int(np.ceil(np.abs(goal - start).max() / STEP)) + 1)
    return np.linspace(start, goal, count)


def _is_leg_free(start: Array, goal: Array, is_free: IsFree) -> bool:
    """Looks at the middle first, then at the middles of the halves: what is in the way is found early."""
    way = leg(start, goal)
    order = sorted(range(len(way)), key=lambda i: i & -i if i else 0, reverse=True)
    return all(is_free(way[i]) for i in order)


def _shortened(corners: list[Array], is_free: IsFree) -> list[Array]:
    rng = np.random.default_rng(0)
    for _ in range(SHORTCUTS):
        if len(corners) < 3:
            break
        first = int(rng.integers(len(corners) - 2))
        last = int(rng.integers(first + 2, len(corners)))
        if _is_leg_free(corners[first], corners[last], is_free):
            corners = corners[: first + 1] + corners[last:]
    return corners


def _connected(start: Array, goal: Array, model: ArmModel, is_free: IsFree, timeout_s: float) -> list[Array]:
    base, geometric, util = (require(f"ompl.{part}", extra="robot") for part in ("base", "geometric", "util"))
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(1)
    space = base.RealVectorStateSpace(JOINTS)
    bounds = base.RealVectorBounds(JOINTS)
    # A window of a turn and a half around both ends: arms that wind themselves up tear their cables.
    low, high = np.minimum(start, goal) - np.pi / 2, np.maximum(start, goal) + np.pi / 2
    for joint in range(JOINTS):
        bounds.setLow(joint, max(float(low[joint]), model.low[joint]))
        bounds.setHigh(joint, min(float(high[joint]), model.high[joint]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    checks, deadline = [0], time.monotonic() + timeout_s

    def is_valid(state: Any) -> bool:
        checks[0] += 1
        return is_free(_joints(state))

    information.setStateValidityChecker(is_valid)
    information.setStateValidityCheckingResolution(STEP / space.getMaximumExtent())
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, start), _state(space, goal))
    planner = geometric.RRTConnect(information)
    planner.setRange(RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    over = base.PlannerTerminationCondition(lambda: checks[0] > CHECKS or time.monotonic() > deadline)
    found = planner.solve(over)
    # Without this the library holds the function, and everything that it knows, until the program ends.
    information.setStateValidityChecker(lambda state: False)
    if not (found and problem.hasExactSolution()):
        raise PlanningFailed(f"no way found in {checks[0]} positions")
    path = problem.getSolutionPath()
    return [_joints(path.getState(i)) for i in range(path.getStateCount())]


def _state(space: Any, joints: Array) -> Any:
    state = space.allocState()
    for joint in range(JOINTS):
        state[joint] = float(joints[joint])
    return state


def _joints(state: Any) -> Array:
    return np.array([state[joint] for joint in range(JOINTS)])
