"""The application: routes, what becomes of errors, and the gate around it."""

from __future__ import annotations

from importlib import metadata

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi_offline import FastAPIOffline
from starlette.exceptions import HTTPException

from neugrasp.errors import InputError
from neugrasp.server.answers import verdict_of
from neugrasp.server.gate import Gate, Refusal, Rules, problem
from neugrasp.server.routes import router
from neugrasp.server.service import Red, Service

DESCRIPTION = """
Photos of a table and photos of it empty in, ranked 6-DoF parallel-jaw grasps and the surface out.

Photos are parts of a multipart request, one for each view, in the order of the views in scene.json. A cell's
cameras and photos of the empty table can be kept (`PUT /v1/cells/{cell}`): then a request brings photos only.
Frames, units and the format of grasps: docs/conventions.md and docs/data_format.md.
"""
SHOWN = 300
"""Characters of a message about a request that does not fit."""


def app_of(service: Service) -> FastAPI:
    """The routes, without the gate."""
    app = FastAPIOffline(
        title="NeuGrasp", version=metadata.version("neugrasp"), description=DESCRIPTION, redoc_url=None
    )
    app.state.service = service
    app.include_router(router)
    app.add_exception_handler(InputError, _unusable)
    app.add_exception_handler(Refusal, _refused)
    app.add_exception_handler(RequestValidationError, _misshapen)
    app.add_exception_handler(HTTPException, _failed)
    app.add_exception_handler(Exception, _crashed)
    return app


def gated(service: Service, host: str, token: str | None) -> Gate:
    """The whole application as it is served; `host` is where the server listens."""
    options = service.options
    rules = Rules(host, token, round(options.largest_mb * 1e6), options.patience_s)
    return Gate(app_of(service), rules, service, service.meters)


async def _unusable(request: Request, error: Exception) -> JSONResponse:
    """The answer to something that the client can mend."""
    more = {"doctor": verdict_of(error.diagnosis)} if isinstance(error, Red) else {}
    return _problem(request, 422, "red" if more else "unusable", str(error), doctor=more.get("doctor"))


async def _refused(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, Refusal)
    answer = _problem(request, error.status, error.reason, error.detail)
    answer.headers.update(error.headers)
    return answer


async def _misshapen(request: Request, error: Exception) -> JSONResponse:
    """The answer to a part that is missing, or of another type."""
    assert isinstance(error, RequestValidationError)
    words = [f"{'.'.join(map(str, one['loc']))}: {one['msg']}" for one in error.errors()]
    return _problem(request, 422, "misshapen", "; ".join(words)[:SHOWN])


async def _failed(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    return _problem(request, error.status_code, "misshapen", str(error.detail)[:SHOWN])


async def _crashed(request: Request, error: Exception) -> JSONResponse:
    """The answer after a mistake of ours; the gate logs what it was, under the name of the request."""
    return _problem(request, 500, "crashed", "a mistake of the server; its log says more")


def _problem(request: Request, status: int, reason: str, detail: str, doctor: object = None) -> JSONResponse:
    visit = request.scope["state"]["visit"]
    visit.reason = reason
    more = {} if doctor is None else {"doctor": doctor}
    content = problem(status, detail, visit.request, **more)
    return JSONResponse(content, status, media_type="application/problem+json")
