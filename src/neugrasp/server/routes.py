"""The addresses of the server and what each of them does."""

from __future__ import annotations

import asyncio
import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata, resources
from pathlib import Path as FilePath
from typing import Annotated, Any, cast

from fastapi import APIRouter, File, Form, Path, Query, Request, UploadFile
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response

from neugrasp.data.photo_files import Photo
from neugrasp.report.prediction import prediction_report
from neugrasp.server.answers import SurfaceFile, Wanted, answer_of
from neugrasp.server.gate import Visit
from neugrasp.server.intake import Cell, steering_of
from neugrasp.server.meters import MEDIA_TYPE
from neugrasp.server.schemas import (
    AnswerModel,
    CellModel,
    ProblemModel,
    WeightsModel,
    example_answer,
    example_problem,
)
from neugrasp.server.service import Found, Service

PLAIN_NAME = re.compile(r"[\w .()-]{1,80}", re.ASCII)
"""File names that messages repeat."""

Name = Annotated[str, Path(pattern=r"^[A-Za-z0-9_.-]{1,64}$", examples=["left_table"])]
SceneFile = Annotated[UploadFile, File(description="scene.json; its names of photos are not looked at")]
Images = Annotated[list[UploadFile], File(description="photos with the objects, in the order of the views")]
Backgrounds = Annotated[list[UploadFile], File(description="photos of the empty table, in the same order")]
Mask = Annotated[UploadFile | None, File(description="a picture of one photo, white where grasps are wanted")]
SteeringText = Annotated[
    str,
    Form(
        description="What is wanted, an object of JSON: region (6 numbers), approach (4), min_height, "
        "one_object, top, mask_view; as in `neugrasp predict`",
        examples=['{"approach": [0, 0, -1, 30], "top": 5}'],
    ),
]
SurfaceQuery = Annotated[SurfaceFile, Query(description="the mesh as a file, in base64")]
Tsdf = Annotated[bool, Query(description="the grid of distances with the detection")]
Force = Annotated[bool, Query(description="an answer even where the doctor says red")]


def _problem(status: int, detail: str) -> dict[str, Any]:
    content = {"application/problem+json": {"example": example_problem(status, detail)}}
    return {"model": ProblemModel, "description": detail, "content": content}


REFUSED: dict[int | str, dict[str, Any]] = {
    status: _problem(status, detail)
    for status, detail in {
        401: "send the server's token",
        403: "a page of another site",
        408: "the body did not come in time",
        413: "the body is too large",
        422: "scene.json, a photo or an option cannot be used; or the doctor says red",
        429: "too many requests are held; Retry-After says when to try again",
        503: "the server is going down",
        504: "the answer took too long",
    }.items()
}
ANSWER: dict[int | str, dict[str, Any]] = {
    200: {"model": AnswerModel, "content": {"application/json": {"example": example_answer()}}},
    **REFUSED,
}
UNKNOWN: dict[int | str, dict[str, Any]] = {404: _problem(404, "there is no cell of that name")}

router = APIRouter()


@router.put("/v1/cells/{cell}", tags=["cells"], response_model=CellModel, responses=REFUSED)
async def put_cell(request: Request, cell: Name, scene: SceneFile, background: Backgrounds) -> Response:
    """Keeps cameras and photos of the empty table, with their features: later requests bring photos only."""
    kept = await _service(request).keep(cell, await scene.read(), await _photos(background))
    return JSONResponse(_cell_facts(cell, kept))


@router.get("/v1/cells", tags=["cells"], response_model=list[CellModel])
async def get_cells(request: Request) -> Response:
    """The cells that are kept."""
    cells = _service(request).cells
    return JSONResponse([_cell_facts(name, cell) for name, cell in sorted(cells.items())])


@router.delete("/v1/cells/{cell}", tags=["cells"], status_code=204, responses=UNKNOWN)
async def delete_cell(request: Request, cell: Name) -> None:
    """Forgets a cell."""
    service = _service(request)
    service.cell(cell)
    del service.cells[cell]


@router.post(
    "/v1/cells/{cell}/detect", tags=["grasps"], response_model=AnswerModel, responses={**ANSWER, **UNKNOWN}
)
async def detect_at_cell(
    request: Request,
    cell: Name,
    image: Images,
    mask: Mask = None,
    steering: SteeringText = "",
    surface: SurfaceQuery = "none",
    tsdf: Tsdf = False,
    force: Force = False,
) -> Response:
    """Grasps of photos at a cell that is kept."""
    wanted = Wanted(surface, tsdf, force)
    found = await _detect(request, _service(request).cell(cell), image, steering, mask, wanted)
    return await _answer(request, found, wanted)


@router.post("/v1/detect", tags=["grasps"], response_model=AnswerModel, responses=ANSWER)
async def detect(
    request: Request,
    scene: SceneFile,
    image: Images,
    background: Backgrounds,
    mask: Mask = None,
    steering: SteeringText = "",
    surface: SurfaceQuery = "none",
    tsdf: Tsdf = False,
    force: Force = False,
) -> Response:
    """Grasps of a whole scene."""
    wanted = Wanted(surface, tsdf, force)
    whole = await scene.read(), await _photos(background)
    return await _answer(request, await _detect(request, whole, image, steering, mask, wanted), wanted)


@router.post("/v1/report", tags=["grasps"], response_class=HTMLResponse, responses=REFUSED)
async def report(
    request: Request, scene: SceneFile, image: Images, background: Backgrounds, force: Force = False
) -> Response:
    """A whole scene in, a page to look at out, as `neugrasp predict --report` writes it."""
    whole = await scene.read(), await _photos(background)
    found = await _detect(request, whole, image, "", None, Wanted(force=force))
    page = await asyncio.to_thread(
        prediction_report, "these photos", found.views, found.detection, found.diagnosis
    )
    return HTMLResponse(page)


@router.get("/v1/weights", tags=["server"], response_model=WeightsModel)
async def weights(request: Request) -> Response:
    """What answers: detector, weights with their hash, threshold, gripper, devices."""
    return JSONResponse({**_service(request).facts, "version": metadata.version("neugrasp")})


@router.get("/healthz", tags=["server"], response_class=PlainTextResponse)
@router.get("/v2/health/live", tags=["server"], response_class=PlainTextResponse)
async def live() -> str:
    """Whether the process answers at all."""
    return "ok\n"


@router.get("/readyz", tags=["server"], response_class=PlainTextResponse, responses={503: {}})
@router.get("/v2/health/ready", tags=["server"], response_class=PlainTextResponse, responses={503: {}})
async def ready(request: Request) -> Response:
    """Whether photos are taken: the weights are loaded, and the server is not going down."""
    is_ready = _service(request).is_ready
    return PlainTextResponse("ready\n" if is_ready else "going down\n", 200 if is_ready else 503)


@router.get("/metrics", tags=["server"], response_class=PlainTextResponse)
async def metrics(request: Request) -> Response:
    """Counters and histograms for Prometheus."""
    return Response(_service(request).meters.page(), media_type=MEDIA_TYPE)


@router.get("/", include_in_schema=False)
async def page() -> HTMLResponse:
    """Where a person drops photos and sees grasps."""
    return HTMLResponse((resources.files("neugrasp.server") / "page.html").read_text(encoding="utf-8"))


async def _detect(
    request: Request,
    scene: Cell | tuple[bytes, Sequence[Photo]],
    images: Sequence[UploadFile],
    steering: str,
    mask: UploadFile | None,
    wanted: Wanted,
) -> Found:
    with _kept(await mask.read() if mask else None) as file:
        asked = steering_of(steering, file)
        photos = await _photos(images)
        return await _service(request).detect(
            scene, photos, asked, wanted, _visit(request), lambda: _gone(request)
        )


async def _answer(request: Request, found: Found, wanted: Wanted) -> Response:
    begun = time.perf_counter()
    content = await asyncio.to_thread(
        answer_of, found.detection, found.diagnosis, wanted, found.seconds, _visit(request).request
    )
    answer = JSONResponse(content)
    _service(request).meters.spent({"answer": time.perf_counter() - begun})
    return answer


async def _gone(request: Request) -> None:
    """Returns when nobody waits for the answer any more."""
    while (await request.receive())["type"] != "http.disconnect":
        pass


async def _photos(files: Sequence[UploadFile]) -> list[Photo]:
    photos = []
    for number, file in enumerate(files):
        name = FilePath(file.filename or "").name
        photos.append(Photo(name if PLAIN_NAME.fullmatch(name) else f"photo {number}", await file.read()))
    return photos


@contextmanager
def _kept(mask: bytes | None) -> Iterator[FilePath | None]:
    """The mask as a file, for as long as the block lasts."""
    if mask is None:
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        file = FilePath(folder) / "mask"
        file.write_bytes(mask)
        yield file


def _cell_facts(name: str, cell: Cell) -> dict[str, Any]:
    sizes = [(frame.camera.width, frame.camera.height) for frame in cell.frames]
    return {"cell": name, "views": len(sizes), "sizes": sizes, "workspace": cell.workspace.to_dict()}


def _service(request: Request) -> Service:
    return cast(Service, request.app.state.service)


def _visit(request: Request) -> Visit:
    return cast(Visit, request.scope["state"]["visit"])
