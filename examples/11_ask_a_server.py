"""Grasps from a server: the weights are loaded once, and any number of robots ask.

    neugrasp serve
    python examples/11_ask_a_server.py

The server holds the weights; who asks needs no torch. Cameras and photos of the empty table are given to
it once, under the name of the cell: it keeps their features, and each question brings new photos only.
What comes back is the same `Detection` as in a process that predicts itself. On another machine:
`neugrasp serve --host 0.0.0.0 --token-file FILE`, and the token here.

Without `--url` a server is started for as long as the example runs.
"""

from __future__ import annotations

import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import tyro

from neugrasp.client import Client
from neugrasp.demo.bundled import demo_scenes
from neugrasp.viewer.door import free_port


@contextmanager
def server(weights: str) -> Iterator[str]:
    """The address of a server that ends with the block."""
    port = free_port("127.0.0.1", None)
    url = f"http://127.0.0.1:{port}"
    command = [sys.executable, "-m", "neugrasp", "serve", "--port", str(port), "--weights", weights]
    with subprocess.Popen(command) as process:
        try:
            while process.poll() is None and not is_ready(url):
                time.sleep(0.2)
            yield url
        finally:
            process.terminate()


def is_ready(url: str) -> bool:
    """Whether the server takes photos."""
    try:
        with urllib.request.urlopen(f"{url}/readyz", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def main(url: str | None = None, scene: Path | None = None, weights: str = "neugrasp") -> None:
    """Keeps a cell, asks it twice, and saves the last answer."""
    folder = scene or demo_scenes()[0].folder
    with nullcontext(url) if url else server(weights) as address, Client(address) as client:
        print(f"{address} answers with {client.weights()['weights']}")
        client.keep_cell("table", folder)
        for _ in range(2):
            begun = time.perf_counter()
            answer = client.ask_at("table", sorted((folder / "images").iterdir()))
            took = time.perf_counter() - begun
            print(f"{len(answer.detection.grasps)} grasps in {took:.2f} s; the doctor: {answer.verdict}")
    answer.detection.save("outputs/asked")


if __name__ == "__main__":
    tyro.cli(main)
