"""What comes back: the same detection as in this process, and the shapes that the description promises."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image

from held_detector import FlatTable
from neugrasp.detection.contract import Detection
from neugrasp.observation import Views

from .conftest import Running, parts_of

WHOLE = ("scene", "image", "background")


def post(served: Running, path: str, parts: list, **options: object) -> httpx.Response:
    return httpx.post(served.url + path, files=parts, timeout=60, **options)


@pytest.mark.slow
def test_a_whole_scene_is_answered_as_the_detector_would(served: Running, scene: Path, views: Views):
    answer = post(served, "/v1/detect?tsdf=true", parts_of(scene, *WHOLE)).json()
    expected, found = FlatTable().detect(views), Detection.from_dict(answer["detection"])
    np.testing.assert_allclose(found.grasps.poses, expected.grasps.poses, atol=1e-12)
    np.testing.assert_array_equal(found.tsdf, expected.tsdf)
    assert found.rejected == expected.rejected
    assert answer["doctor"] == {"level": "green", "verdict": "green", "findings": []}
    assert set(answer["seconds"]) == {"decode", "examine", "queue"}


@pytest.mark.slow
def test_a_cell_that_is_kept_needs_photos_only(served: Running, scene: Path):
    parts = parts_of(scene, "scene", "background")
    kept = httpx.put(f"{served.url}/v1/cells/left", files=parts).json()
    assert (kept["cell"], kept["views"], kept["sizes"]) == ("left", 4, [[256, 256]] * 4)
    assert [cell["cell"] for cell in httpx.get(f"{served.url}/v1/cells").json()] == ["left"]
    at_cell = post(served, "/v1/cells/left/detect", parts_of(scene, "image")).json()
    whole = post(served, "/v1/detect", parts_of(scene, *WHOLE)).json()
    assert at_cell["detection"]["grasps"] == whole["detection"]["grasps"]
    assert served.service.cells["left"].table is not None
    assert at_cell["doctor"] == whole["doctor"]
    assert httpx.delete(f"{served.url}/v1/cells/left").status_code == 204
    assert post(served, "/v1/cells/left/detect", parts_of(scene, "image")).status_code == 404


@pytest.mark.slow
def test_the_surface_comes_as_a_file_where_it_is_asked_for(served: Running, scene: Path):
    parts = parts_of(scene, *WHOLE)
    vertices = {}
    for kind in ("glb", "ply"):
        surface = post(served, f"/v1/detect?surface={kind}", parts).json()["surface"]
        assert surface["format"] == kind
        vertices[kind] = len(VERTICES[kind](base64.b64decode(surface["base64"])))
    assert vertices["glb"] == vertices["ply"] > 1000
    assert "surface" not in post(served, "/v1/detect", parts).json()


def in_glb(data: bytes) -> np.ndarray:
    magic, _, length = struct.unpack_from("<III", data)
    assert (magic, length) == (0x46546C67, len(data))
    (size,) = struct.unpack_from("<I", data, 12)
    head = json.loads(data[20 : 20 + size])
    return np.empty((head["accessors"][0]["count"], 3))


def in_ply(data: bytes) -> np.ndarray:
    head, _, body = data.partition(b"end_header\n")
    (count,) = (int(line.split()[-1]) for line in head.splitlines() if line.startswith(b"element vertex"))
    return np.frombuffer(body, "<f8", 3 * count).reshape(-1, 3)


VERTICES = {"glb": in_glb, "ply": in_ply}


@pytest.mark.parametrize(
    ("steering", "left", "reason"),
    [
        ({"top": 1}, 1, "beyond_the_best"),
        ({"approach": [0, 0, 1, 10]}, 0, "from_another_side"),
        ({"region": [0, 0, 0, 0.01, 0.01, 0.01]}, 0, "outside_the_region"),
        ({"min_height": 0.015}, 1, "too_low"),
    ],
)
def test_it_can_be_steered(served: Running, scene: Path, steering: dict, left: int, reason: str):
    data = {"steering": json.dumps(steering)}
    answer = post(served, "/v1/detect", parts_of(scene, *WHOLE), data=data).json()
    assert len(answer["detection"]["grasps"]) == left
    assert answer["detection"]["rejected"][reason] == 2 - left


@pytest.mark.slow
def test_a_mask_is_a_part(served: Running, scene: Path):
    image = (scene / "images/0.png").read_bytes()
    with Image.open(scene / "images/0.png") as photo:
        mask = io.BytesIO()
        white = Image.new("L", photo.size, 255)
        white.paste(0, (0, 0, 8, 8))
        white.save(mask, "PNG")
    with_mask, with_photo = (
        [*parts_of(scene, *WHOLE), ("mask", ("mask.png", content))] for content in (mask.getvalue(), image)
    )
    named = {"steering": '{"mask_view": 0}'}
    assert post(served, "/v1/detect", with_mask, data=named).status_code == 200
    for answer, wrong in (
        (post(served, "/v1/detect", with_mask), "mask_view"),
        (post(served, "/v1/detect", with_photo, data=named), "photo"),
    ):
        assert answer.status_code == 422
        assert wrong in answer.json()["detail"]


def test_red_is_refused_with_what_to_do_unless_it_is_forced(served: Running, scene: Path):
    parts = parts_of(scene, "scene", "image")
    parts += [("background", image[1]) for image in parts[1:]]
    refused = post(served, "/v1/detect", parts)
    assert refused.status_code == 422
    assert refused.headers["content-type"] == "application/problem+json"
    assert refused.json()["doctor"]["level"] == "red"
    assert all(finding["remedy"] for finding in refused.json()["doctor"]["findings"])
    assert post(served, "/v1/detect?force=true", parts).json()["doctor"]["level"] == "red"


@pytest.mark.slow
def test_a_page_to_look_at(served: Running, scene: Path):
    page = post(served, "/v1/report", parts_of(scene, *WHOLE))
    assert page.headers["content-type"].startswith("text/html")
    assert "2 grasps for the panda gripper" in page.text


@pytest.mark.slow
def test_answers_have_the_shapes_that_are_described(served: Running, scene: Path):
    schemas = pytest.importorskip("neugrasp.server.schemas")
    answer = post(served, "/v1/detect?tsdf=true&surface=ply", parts_of(scene, *WHOLE)).json()
    model = schemas.AnswerModel.model_validate(answer)
    assert model.detection.grasps[0].score == 0.9
    problem = post(served, "/v1/detect", parts_of(scene, "scene")).json()
    assert "image" in schemas.ProblemModel.model_validate(problem).detail
    schemas.WeightsModel.model_validate(httpx.get(f"{served.url}/v1/weights").json())
    schemas.AnswerModel.model_validate(schemas.example_answer())


def test_every_address_is_described_with_an_example(served: Running):
    described = httpx.get(f"{served.url}/openapi.json").json()
    detecting = [path for path in described["paths"] if path.endswith("detect")]
    assert len(detecting) == 2
    for path in detecting:
        operation = described["paths"][path]["post"]
        example = operation["responses"]["200"]["content"]["application/json"]["example"]
        assert Detection.from_dict(example["detection"]).grasps[0].score == 0.93
        assert {"401", "413", "422", "429", "503", "504"} <= set(operation["responses"])
    for path, operations in described["paths"].items():
        for operation in operations.values():
            assert operation["description"], path


def test_the_description_page_loads_nothing_from_elsewhere(served: Running):
    page = httpx.get(f"{served.url}/docs").text
    assert "static-offline-docs/swagger-ui-bundle.js" in page
    assert "https://" not in page
    assert httpx.get(f"{served.url}/static-offline-docs/swagger-ui-bundle.js").status_code == 200


@pytest.mark.slow
def test_life_and_readiness(served: Running):
    for path in ("/healthz", "/readyz", "/v2/health/live", "/v2/health/ready"):
        assert httpx.get(served.url + path).status_code == 200
    served.service.is_ready = False
    try:
        assert httpx.get(f"{served.url}/healthz").status_code == 200
        assert httpx.get(f"{served.url}/readyz").status_code == 503
    finally:
        served.service.is_ready = True


@pytest.mark.slow
def test_counters(served: Running, scene: Path):
    def counted() -> dict[str, float]:
        lines = httpx.get(f"{served.url}/metrics").text.splitlines()
        return {line.rsplit(" ", 1)[0]: float(line.rsplit(" ", 1)[1]) for line in lines if line[:1] != "#"}

    before = counted()
    post(served, "/v1/detect", parts_of(scene, *WHOLE))
    post(served, "/v1/detect", parts_of(scene, "scene"))
    grown = {name: value - before.get(name, 0) for name, value in counted().items()}
    assert grown['neugrasp_requests_total{route="/v1/detect",status="200"}'] == 1
    assert grown['neugrasp_refused_requests_total{reason="misshapen"}'] == 1
    assert grown['neugrasp_doctor_verdicts_total{level="green"}'] == 1
    assert grown['neugrasp_rejected_candidates_total{reason="too_narrow"}'] == 7
    assert grown["neugrasp_grasps_total"] == 2
    for stage in ("decode", "examine", "queue", "look", "answer"):
        assert grown[f'neugrasp_stage_seconds_count{{stage="{stage}"}}'] == 1
    assert before["process_resident_memory_bytes"] > 0
