"""Pictures for people: grasps drawn into photos, shaded surfaces, slices of the grid, contact sheets."""

from neugrasp.pictures.files import write_picture
from neugrasp.pictures.overlay import draw_grasps, photo_of_workspace
from neugrasp.pictures.overview import detection_picture, opposite, overlay_sheet, surface_sheet
from neugrasp.pictures.score_scale import colour_of_score, score_legend
from neugrasp.pictures.shading import free_where_unseen, shade_surface
from neugrasp.pictures.sheet import Tile, contact_sheet
from neugrasp.pictures.slices import slice_picture

__all__ = [
    "Tile",
    "colour_of_score",
    "contact_sheet",
    "detection_picture",
    "draw_grasps",
    "free_where_unseen",
    "opposite",
    "overlay_sheet",
    "photo_of_workspace",
    "score_legend",
    "shade_surface",
    "slice_picture",
    "surface_sheet",
    "write_picture",
]
