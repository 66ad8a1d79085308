"""The drawing docs/grasp_frames.svg: one gripper, and where every convention puts its frame in it.

The frames come from the exporters themselves, for a grasp whose own frame is the identity.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from neugrasp.exporters import graspnet, ros, vgn
from neugrasp.geometry.pose import Array, from_quaternion, rigid
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

FILE = Path(__file__).parents[2] / "docs/grasp_frames.svg"
WIDTH = 0.05
SCALE = 1900
"""Dots per metre."""
PANEL, HEIGHT, MIDDLE, TCP_ROW = 250, 400, 118, 290
"""Width of a panel, height of the drawing, and where in a panel the TCP is, in dots."""
AXIS = 0.024
"""Length of a drawn axis, metres."""
COLOURS = {"x": "#c62828", "y": "#2e7d32", "z": "#1565c0"}


def frames(gripper: Gripper) -> dict[str, tuple[Array, str]]:
    """The frame of every convention in our grasp frame, and what it says below its picture."""
    grasp = Grasp(np.eye(4), WIDTH)
    (row,) = graspnet.encode([grasp], gripper)
    (line,) = vgn.encode([grasp], gripper)
    (hand,) = ros.encode([grasp], gripper, ros.Stamp(link="hand"))
    return {
        "NeuGrasp, ROS (link tcp)": (np.eye(4), "TCP, between the pads"),
        "ROS (link hand)": (
            ros.pose_of(hand["grasp_pose"]),
            f"flange, {mm(gripper.tcp_height)} before the TCP",
        ),
        "VGN, GIGA": (
            from_quaternion(line[:4], line[4:7]),
            f"grasp point, {mm(gripper.tcp_depth)} before the TCP",
        ),
        "GraspNet, AnyGrasp": (
            rigid(row[4:13].reshape(3, 3), row[13:16]),
            f"depth = {mm(row[3])}, to the finger tips",
        ),
    }


def drawing() -> str:
    """The SVG."""
    gripper = Gripper.load("panda")
    panels = [
        f'<g transform="translate({i * PANEL} 0)">{_panel(gripper, title, *frame)}</g>'
        for i, (title, frame) in enumerate(frames(gripper).items())
    ]
    width = PANEL * len(panels)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" width="{width}" '
        f'height="{HEIGHT}" font-family="sans-serif" font-size="13" text-anchor="middle">\n'
        f'<rect width="{width}" height="{HEIGHT}" fill="white"/>\n' + "\n".join(panels) + "\n</svg>\n"
    )


def mm(metres: float) -> str:
    return f"{1000 * metres:.0f} mm"


def _dot(point: Array) -> tuple[float, float]:
    """Where a point of our grasp frame is drawn: y to the right, z, the approach, downwards."""
    return MIDDLE + SCALE * float(point[1]), TCP_ROW + SCALE * float(point[2])


def _line(start: Array, end: Array, colour: str, width: float) -> str:
    (x1, y1), (x2, y2) = _dot(start), _dot(end)
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
        f'stroke-width="{width}" stroke-linecap="round"/>'
    )


def _panel(gripper: Gripper, title: str, frame: Array, below: str) -> str:
    parts = [_line(start, end, "#9e9e9e", 7) for start, end in gripper.wireframe(WIDTH)]
    flange = np.array([0, 0, -gripper.tcp_height])
    aside, palm = np.array([0, 0.015, 0]), np.array([0, 0, gripper.palm_height - gripper.tcp_height])
    parts += [_line(flange - aside, flange + aside, "#9e9e9e", 7), _line(flange, palm, "#9e9e9e", 7)]
    x, y = _dot(np.zeros(3))
    radius = SCALE * WIDTH / 2 - 4
    parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="#fff3e0" stroke="#ffb74d"/>')
    parts += [_axis(frame[:3, 3], frame[:3, i], name) for i, name in enumerate("xyz")]
    parts.append(f'<text x="{MIDDLE}" y="24" font-size="15" font-weight="bold">{title}</text>')
    parts.append(f'<text x="{MIDDLE}" y="{HEIGHT - 18}">{below}</text>')
    return "".join(parts)


def _axis(origin: Array, direction: Array, name: str) -> str:
    """An arrow in the plane of the drawing, or a circle: with a dot towards the reader, with a cross away."""
    colour = COLOURS[name]
    x, y = _dot(origin)
    towards = -float(direction[0])
    if abs(towards) > 0.5:
        ring = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7" fill="white" stroke="{colour}" stroke-width="2"/>'
        if towards > 0:
            inside = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="{colour}"/>'
        else:
            inside = "".join(
                f'<path d="M{x - 5:.1f} {y - 5 * s:.1f}L{x + 5:.1f} {y + 5 * s:.1f}" stroke="{colour}" '
                'stroke-width="2"/>'
                for s in (1, -1)
            )
        return ring + inside + f'<text x="{x - 15:.1f}" y="{y - 6:.1f}" fill="{colour}">{name}</text>'
    tip = origin + AXIS * direction
    (tip_x, tip_y), (text_x, text_y) = _dot(tip), _dot(origin + 1.35 * AXIS * direction)
    along = np.array([tip_x - x, tip_y - y]) / np.hypot(tip_x - x, tip_y - y)
    across = np.array([-along[1], along[0]])
    corners = [np.array([tip_x, tip_y]) - 8 * along + 4 * side * across for side in (1, -1)]
    head = " ".join(
        f"{px:.1f},{py:.1f}"
        for px, py in [corners[0], (tip_x + along[0] * 3, tip_y + along[1] * 3), corners[1]]
    )
    return (
        _line(origin, tip, colour, 3)
        + f'<polygon points="{head}" fill="{colour}"/>'
        + f'<text x="{text_x:.1f}" y="{text_y + 4:.1f}" fill="{colour}">{name}</text>'
    )
