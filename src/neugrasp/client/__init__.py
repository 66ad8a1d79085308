"""Grasps from a server (`neugrasp serve`), for programs on other machines: httpx, and no torch.

    from neugrasp.client import Client

    with Client("http://gpu-box:8421", token="...") as client:
        client.keep_cell("left", "my_scene")  # cameras and photos of the empty table, once
        detection = client.detect_at("left", ["0.png", "1.png", "2.png", "3.png"])

`AsyncClient` has the same methods, to be awaited.
"""

from __future__ import annotations

from neugrasp.client.client import AsyncClient, Client
from neugrasp.client.messages import Answer, ServerError
from neugrasp.client.token import read_token

__all__ = ["Answer", "AsyncClient", "Client", "ServerError", "read_token"]
