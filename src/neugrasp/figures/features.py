"""Scene features beside foreground-attentive features: the paper's Fig. 4 for one model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw

from neugrasp.errors import InputError
from neugrasp.figures.embedding import principal_components, share_of_like_neighbours, tsne
from neugrasp.figures.figure_inputs import FigureInput
from neugrasp.geometry.pose import Array
from neugrasp.model.inputs import ViewTensors, prepare
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Image
from neugrasp.pictures import Tile, contact_sheet

SIZE = 384
"""Pixels of a picture's edge."""
PIXELS = 800
"""Embedded at most, half of them of objects where there are enough."""
CHANGED = 0.1
"""Mean difference of the channels from the background, 0 to 1, from which a pixel counts as object where no
masks tell."""
NEIGHBOURS = 10
"""Asked whether they are object, too."""
PERCENTILES = (1, 99)
"""Percentiles of a component: what lies beyond has the colour of the end."""
PAPER = (250, 250, 250)
TABLE = (190, 184, 172)
COLOURS = np.array(
    [
        (31, 119, 180),
        (230, 110, 20),
        (44, 150, 44),
        (214, 39, 40),
        (148, 103, 189),
        (140, 86, 75),
        (227, 119, 194),
    ]
)
"""Colours of objects, in turn."""
DOT = 3.5
"""Radius in pixels."""
OVERSAMPLING, FILLED = 3, 0.92


@dataclass(frozen=True)
class FeatureMaps:
    """What the network makes of the photos, and what is where in them."""

    photos: NDArray[np.float32]
    """(n, s, s, 3) in [0, 1], as the network sees them."""
    scene: Array
    """(n, h, w, d) features of the photos."""
    attentive: Array
    """(n, h, w, d) the same, gated by their difference from the background's (Eq. 7)."""
    kinds: NDArray[np.int64]
    """(n, h, w): 0 table and all else, i + 1 object i."""
    are_known: bool
    """Whether `kinds` comes from masks; else 1 is whatever changed against the background."""
    measured: NDArray[np.bool_]
    """(n, h, w): what the sensor saw; the rest of a photo repeats its edge."""


@torch.no_grad()
def feature_maps(source: FigureInput, model: NeuGrasp) -> FeatureMaps:
    """The maps of all photos. Raises `InputError` for a model without residual attention."""
    if model.residual is None:
        raise InputError(
            "these weights are of a model without residual attention; there is nothing to compare"
        )
    inputs = prepare(source.views, model.config.image_size)
    scene = model.encode(inputs.images)
    attentive = model.residual(scene, model.encode(inputs.backgrounds))
    kinds = _kinds(source, inputs, scene.shape[-1])
    return FeatureMaps(
        _last(inputs.images).astype(np.float32),
        _last(scene),
        _last(attentive),
        _changed(inputs, scene.shape[-1]) if kinds is None else kinds,
        kinds is not None,
        _measured(inputs, scene.shape[-1]),
    )


def features_figure(source: FigureInput, model: NeuGrasp, rng: np.random.Generator) -> Image:
    """Above: a photo and both feature maps, their first three principal components as red, green and blue.
    Below: what is where, and both kinds of features of some pixels of all photos by t-SNE."""
    maps = feature_maps(source, model)
    chosen = sample(maps.kinds.reshape(-1), maps.measured.reshape(-1), rng, PIXELS)
    kinds = maps.kinds.reshape(-1)[chosen]
    seen = maps.measured[source.index]

    def tile(image: NDArray[np.generic], caption: str) -> Tile:
        return Tile(_enlarged(image, seen), caption)

    columns = [(maps.scene, "scene features"), (maps.attentive, "foreground-attentive features")]
    above = [tile(maps.photos[source.index] * 255, f"{source.name}, photo {source.index}")]
    legend = "objects by colour, table grey" if maps.are_known else "blue: what differs from the background"
    below = [tile(paint(maps.kinds[source.index]), legend)]
    for features, words in columns:
        above.append(tile(component_colours(features, maps.measured)[source.index], f"{words}, PCA"))
        vectors = features.reshape(-1, features.shape[-1])[chosen]
        share = share_of_like_neighbours(vectors, kinds > 0, NEIGHBOURS)
        height, width = below[0].image.shape[:2]
        cloud = scatter(tsne(vectors), paint(kinds), (width, height))
        below.append(Tile(cloud, f"t-SNE; {100 * share:.1f} % of neighbours alike"))
    return contact_sheet(
        [*above, *below], columns=3, title="Features before and after the residual enhancement"
    )


def sample(
    kinds: NDArray[np.int64], measured: NDArray[np.bool_], rng: np.random.Generator, most: int
) -> NDArray[np.int64]:
    """Indices of at most `most` measured pixels, as many of objects as of the rest where both have enough."""
    is_object = kinds > 0
    groups = [rng.permutation(np.flatnonzero(measured & group)) for group in (is_object, ~is_object)]
    fewest = min(len(group) for group in groups)
    take = max(most // 2, most - fewest)
    return np.sort(np.concatenate([group[:take] for group in groups]))


def component_colours(features: Array, measured: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Maps (n, h, w, d) as RGB (n, h, w, 3): their first three principal components, which range from dark to
    bright over the measured pixels (n, h, w)."""
    flat = principal_components(features.reshape(-1, features.shape[-1]), 3)
    low, high = np.percentile(flat[measured.reshape(-1)], PERCENTILES, axis=0)
    scaled = (flat - low) / np.maximum(high - low, 1e-9)
    return (255 * scaled.clip(0, 1)).round().astype(np.uint8).reshape(*features.shape[:-1], 3)


def paint(kinds: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Colours (..., 3) of kinds (...): 0 grey, every object its own."""
    colours = COLOURS[(kinds - 1) % len(COLOURS)]
    return np.where(kinds[..., None] > 0, colours, TABLE).astype(np.uint8)


def scatter(points: Array, colours: NDArray[np.uint8], size: tuple[int, int]) -> Image:
    """Points (n, 2) as dots of their colours (n, 3) in a picture of `size` (width, height)."""
    large = np.array(size) * OVERSAMPLING
    low, high = points.min(axis=0), points.max(axis=0)
    scale = FILLED * float(np.min(large / np.maximum(high - low, 1e-9)))
    places = (points - (low + high) / 2) * scale + large / 2
    picture = Picture.new("RGB", (int(large[0]), int(large[1])), PAPER)
    pen = ImageDraw.Draw(picture)
    radius = OVERSAMPLING * DOT
    for (x, y), colour in zip(places.tolist(), colours.tolist(), strict=True):
        pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=tuple(colour), outline=PAPER)
    return np.asarray(picture.resize(size, Picture.Resampling.BOX))


def _kinds(source: FigureInput, inputs: ViewTensors, size: int) -> NDArray[np.int64] | None:
    """From the masks, where there are some of the photos as the network sees them."""
    if source.truth is None or source.truth.masks.shape[1:] != tuple(inputs.images.shape[2:]):
        return None
    step = source.truth.masks.shape[1] // size
    return source.truth.masks[:, step // 2 :: step, step // 2 :: step].clip(0).astype(np.int64)


def _changed(inputs: ViewTensors, size: int) -> NDArray[np.int64]:
    difference = (inputs.images - inputs.backgrounds).abs().mean(1, keepdim=True)
    small = torch.nn.functional.interpolate(difference, (size, size), mode="area")
    return (small[:, 0] > CHANGED).numpy().astype(np.int64)


def _last(maps: torch.Tensor) -> Array:
    """(n, c, h, w) as (n, h, w, c)."""
    return maps.permute(0, 2, 3, 1).double().numpy()


def _measured(inputs: ViewTensors, size: int) -> NDArray[np.bool_]:
    """(n, size, size): whether the middle of a feature's pixel is measured."""
    places = (np.arange(size) + 0.5) * inputs.images.shape[-1] / size - 0.5
    u, v = np.meshgrid(places, places)
    left, top, right, bottom = inputs.cameras.bounds.double().numpy().T[:, :, None, None]
    return np.asarray((u > left) & (u < right) & (v > top) & (v < bottom))


def _enlarged(image: NDArray[np.generic], seen: NDArray[np.bool_]) -> Image:
    """The part of a picture that was measured, by a map (h, w) of it, its longer side `SIZE` pixels."""
    factor = len(image) // len(seen)
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    part = image[rows[0] * factor : (rows[-1] + 1) * factor, columns[0] * factor : (columns[-1] + 1) * factor]
    picture = Picture.fromarray(np.asarray(part).round().astype(np.uint8))
    scale = SIZE / max(picture.size)
    size = (round(picture.width * scale), round(picture.height * scale))
    way = Picture.Resampling.BICUBIC if factor > 1 else Picture.Resampling.NEAREST
    return np.asarray(picture.resize(size, way))
