"""One object from a user's URDF, as the physics engine would load it, or an error that names what is wrong.

The meshes of the model lie in the frame of the link: where the URDF scales or moves them, or they are STL,
copies are written into the cache.
"""

from __future__ import annotations

import hashlib
import logging
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from neugrasp.data.spelling import plain
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, rigid
from neugrasp.simulation.mesh_checks import beside, check_pair, check_solid
from neugrasp.simulation.meshes import Mesh, is_for_engine, read_mesh, write_obj
from neugrasp.simulation.object_model import EngineShape, ObjectModel, cache_folder, triple

log = logging.getLogger(__name__)

MASSES = (1e-4, 50.0)
"""Kilograms that an object may have."""
FRICTIONS = (0.0, 10.0)
WHOLE_TURN = 2 * np.pi + 1e-3
"""Radians."""
MOTION = re.compile(r"origin|pose|scale|transform|quat\w*|r?py|xyz|rotation|translation|position|unit\w*")
"""What moves, turns or scales, in plain letters: elements and attributes."""
ATTRIBUTES = {"origin": ("xyz", "rpy"), "mesh": ("filename", "scale")}
FARTHEST = 1000.0
"""Largest coordinate in a URDF: metres, or units of a mesh that is scaled."""
URDF_LIMIT = 1_000_000
"""Bytes of a URDF."""


@dataclass(frozen=True)
class _Shape:
    """A mesh and where a URDF puts it."""

    file: Path
    scale: Array
    """(3,)"""
    xyz: Array
    rpy: Array
    """Place and turn of the scaled mesh: metres, and radians about fixed axes."""

    @property
    def link_from_mesh(self) -> Array:
        """(4, 4), of the scaled mesh."""
        return rigid(Rotation.from_euler("xyz", self.rpy).as_matrix(), self.xyz)

    @property
    def is_plain(self) -> bool:
        """Whether the file says it all."""
        stays = np.all(self.scale == 1) and not np.any(self.xyz) and not np.any(self.rpy)
        return bool(stays) and self.file.suffix.lower() == ".obj" and is_for_engine(self.file)

    def parts(self) -> tuple[Mesh, ...]:
        """The mesh in the frame of the link, metres."""
        if self.is_plain:
            return read_mesh(self.file)
        return tuple(part.placed(self.scale, self.link_from_mesh) for part in read_mesh(self.file))

    def written(self, parts: tuple[Mesh, ...]) -> Path:
        """An OBJ file of `parts`: the URDF's own where it says it all."""
        if self.is_plain:
            return self.file
        content = hashlib.sha256(self.file.read_bytes())
        content.update(self.scale.tobytes() + self.link_from_mesh.tobytes())
        path = cache_folder() / "placed-2" / f"{content.hexdigest()[:40]}.obj"
        if not path.exists():
            write_obj(path, parts, decimals=10)
        return path


def read_urdf(path: Path, name: str, root: Path) -> ObjectModel:
    """The single body of a URDF whose meshes lie in `root`. Raises `InputError` naming the bad file."""
    link = _link(path)
    if len(link.findall("inertial")) > 1:
        raise InputError(f"{path}: has two <inertial>; which one is meant?")
    _check_children(path, link.find("inertial"), ("origin", "mass"))
    mass = _value(path, link, "inertial/mass", *MASSES, "kg")
    friction = 1.0
    if link.find("contact/lateral_friction") is not None:
        friction = _value(path, link, "contact/lateral_friction", *FRICTIONS, "")
    visual, collision = (tuple(_shapes(path, root, link, role)) for role in ("visual", "collision"))
    if len(visual) != 1 or not collision:
        raise InputError(f"{path}: needs one visual mesh and at least one collision mesh")
    seen, touched = visual[0].parts(), [shape.parts() for shape in collision]
    check_solid(seen, visual[0].file)
    middle, rpy = _origin(path, link.find("inertial"))
    parts = tuple(part for parts in touched for part in parts)
    check_pair(seen, parts, path)
    _check_centre(path, link, (*seen, *parts), middle)
    return ObjectModel(
        name,
        visual[0].written(seen),
        tuple(shape.written(parts) for shape, parts in zip(collision, touched, strict=True)),
        mass,
        friction,
        triple(middle),
        triple(rpy),
        () if all(shape.is_plain for shape in collision) else tuple(map(_for_engine, collision)),
    )


def _check_centre(path: Path, link: Element, parts: tuple[Mesh, ...], middle: Array) -> None:
    """Raises `InputError` where the URDF puts the centre of mass beside the body, and says so where it does
    not put it anywhere: then the engine takes the origin of the link."""
    problem = beside(parts, middle)
    if problem and link.find("inertial/origin") is not None:
        raise InputError(f"{path}: {problem}; <inertial><origin xyz=...> is in metres, in the link's frame")
    if problem:
        log.warning("%s: %s, for want of an <inertial><origin xyz=...>", path, problem)


def _for_engine(shape: _Shape) -> EngineShape:
    """The file as it is, but for one that the engine would read otherwise: of that it gets another OBJ."""
    file = shape.file
    if not is_for_engine(file):
        unmoved = _Shape(file, np.ones(3), np.zeros(3), np.zeros(3))
        file = unmoved.written(unmoved.parts())
    return EngineShape(file, triple(shape.scale), triple(shape.xyz), triple(shape.rpy))


def files_of(path: Path, root: Path) -> Iterator[Path]:
    """The URDF and the meshes that it names, those that can be found."""
    yield path
    try:
        meshes = _link(path).findall(".//geometry/mesh")
    except InputError:
        return
    for mesh in meshes:
        try:
            yield _mesh_file(path, root, mesh)
        except InputError:
            continue


def _link(path: Path) -> Element:
    """The one link of a URDF."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) or status.st_size > URDF_LIMIT:
            raise InputError(f"{path}: is no file of at most {URDF_LIMIT / 1e6:.0f} MB, which a URDF is")
        links = ElementTree.parse(path).getroot().findall("link")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a URDF with a mass and meshes ({error})") from error
    if not links:
        raise InputError(f"{path}: has no <link>")
    if len(links) > 1:
        raise InputError(f"{path}: has {len(links)} links; an object is one rigid body, one <link>")
    return links[0]


def _value(path: Path, link: Element, tag: str, low: float, high: float, unit: str) -> float:
    element = link.find(tag)
    words = "" if element is None else element.get("value", "")
    try:
        value = float(words)
    except ValueError:
        raise InputError(f"{path}: not a URDF with a mass and meshes (<{tag}> is {words!r})") from None
    if tag.endswith("mass") and not value > 0:
        raise InputError(f"{path}: mass {value} kg; it must be greater than 0")
    if not low <= value <= high:
        raise InputError(f"{path}: <{tag}> is {value:g}; it must be from {low:g} to {high:g} {unit}".rstrip())
    return value


def _shapes(path: Path, root: Path, link: Element, role: str) -> Iterator[_Shape]:
    for element in link.findall(role):
        mesh = element.find("geometry/mesh")
        if mesh is None:
            kinds = [shape.tag for shape in element.findall("geometry/*")]
            raise InputError(f"{path}: a <{role}> is {' and '.join(kinds) or 'empty'}; it must be a <mesh>")
        _check_children(path, element, ("origin", "geometry"))
        _check_children(path, element.find("geometry"), ("mesh",))
        _check_children(path, mesh, ())
        xyz, rpy = _origin(path, element)
        yield _Shape(_mesh_file(path, root, mesh), _scale(path, mesh), xyz, rpy)


def _check_children(path: Path, element: Element | None, known: tuple[str, ...]) -> None:
    """Raises `InputError` where what `element` holds would be twice there, or moves or scales it in a way
    that is not of URDF (SDF's <pose>, another spelling), which the engine leaves out."""
    if element is None:
        return
    tags = [child.tag for child in element]
    for tag in tags:
        if tag not in known and MOTION.fullmatch(plain(tag)):
            raise InputError(
                f"{path}: <{tag}> in a <{element.tag}> is not of URDF; write <origin xyz rpy>, "
                "and scale=... into the <mesh>"
            )
        if tag in known and tags.count(tag) > 1:
            raise InputError(f"{path}: a <{element.tag}> has two <{tag}>; which one is meant?")
    right = ATTRIBUTES.get(element.tag, ())
    for name in element.attrib:
        if name not in right and MOTION.fullmatch(plain(name)):
            raise InputError(
                f"{path}: {name}=... of a <{element.tag}> is not of URDF; it knows "
                f"{', '.join(right) or 'none'}"
            )


def _origin(path: Path, element: Element | None) -> tuple[Array, Array]:
    """xyz in metres, and roll, pitch and yaw about fixed axes in radians."""
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.zeros(3), np.zeros(3)
    _check_children(path, origin, ())
    xyz, rpy = (_numbers(path, f"<origin {key}>", origin.get(key, "0 0 0"), (3,)) for key in ("xyz", "rpy"))
    if np.abs(rpy).max() > WHOLE_TURN:
        raise InputError(
            f"{path}: <origin rpy> is {origin.get('rpy')!r}, more than a whole turn; it must be in radians"
        )
    return xyz, rpy


def _scale(path: Path, mesh: Element) -> Array:
    scale = _numbers(path, "scale", mesh.get("scale", "1 1 1"), (1, 3)) * np.ones(3)
    if not np.all(scale):
        raise InputError(f"{path}: scale {mesh.get('scale')!r} is 0 along an axis; the mesh would be flat")
    return scale


def _numbers(path: Path, what: str, words: str, counts: tuple[int, ...]) -> Array:
    try:
        numbers = np.array([float(word) for word in words.split()])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) not in counts or not np.all(np.abs(numbers) <= FARTHEST):
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{path}: {what} is {words[:60]!r}; it must be {wanted} numbers up to {FARTHEST:g}")
    return numbers


def _mesh_file(urdf: Path, root: Path, mesh: Element) -> Path:
    """The file of a mesh, below `root`."""
    name = mesh.get("filename", "")
    if not name or "\0" in name:
        raise InputError(f"{urdf}: not a URDF with a mass and meshes (a <mesh> without a filename)")
    if "://" in name:
        return _in_package(urdf, root, name)
    path = (urdf.parent / name.replace("\\", "/")).resolve()
    if not path.is_relative_to(root.resolve()):
        raise InputError(f"{urdf}: mesh {name!r} lies outside {root}")
    return path


def _in_package(urdf: Path, root: Path, name: str) -> Path:
    """The file of package://NAME/PATH: NAME is a folder above the URDF, or lies in one, up to `root`."""
    kind, _, rest = name.partition("://")
    package, _, inside = rest.partition("/")
    top = root.resolve()
    folders = [folder for folder in urdf.resolve().parents if folder.is_relative_to(top)]
    found = [folder / rest for folder in folders] + [f / inside for f in folders if f.name == package]
    if kind in ("package", "model") and ".." not in Path(rest).parts and inside:
        for path in found:
            if path.is_file() and path.resolve().is_relative_to(top):
                return path.resolve()
    raise InputError(
        f"{urdf}: mesh {name!r} is not found; no folder {package!r} with it lies in {root}; ROS is "
        "not asked: write the path from the URDF to the mesh"
    )
