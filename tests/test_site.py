"""The documentation as a site: all of it is there, no link leads nowhere, nothing comes from elsewhere."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
NOWHERE = "http://127.0.0.1:9"
"""A proxy that takes no connection: whoever wants the network fails."""


def test_every_page_is_in_the_menu():
    menu = set(re.findall(r"([a-z_]+\.md)", (ROOT / "mkdocs.yml").read_text()))
    assert {page.name for page in DOCS.glob("*.md")} <= menu


def test_the_drawn_diagram_is_that_of_the_page():
    """docs/site/hooks.py says how it is drawn again."""
    (source,) = re.findall(r"^```mermaid\n(.*?)^```", (DOCS / "architecture.md").read_text(), re.S | re.M)
    assert hashlib.sha256(source.encode()).hexdigest() in (DOCS / "pictures/data_flow.svg").read_text()


class Document(HTMLParser):
    """What a page of HTML links to, loads, and offers as a target."""

    def __init__(self, file: Path):
        super().__init__()
        self.links: set[str] = set()
        self.loads: set[str] = set()
        self.targets: set[str] = {""}
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.targets |= {values[name] for name in ("id", "name") if name in values}
        if "href" in values:
            (self.links if tag == "a" else self.loads).add(values["href"])
        if "src" in values:
            self.loads.add(values["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed (pip install 'neugrasp[docs]')")
    folder = tmp_path_factory.mktemp("site")
    proxies = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), NOWHERE)
    result = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)],
        check=False,
        cwd=ROOT,
        env={**os.environ, **proxies, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "WARNING" not in result.stdout + result.stderr
    return folder


@pytest.fixture(scope="module")
def documents(site: Path) -> dict[Path, Document]:
    return {file: Document(file) for file in site.rglob("*.html") if file.name != "404.html"}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_site_loads_nothing_from_elsewhere(site: Path, documents: dict[Path, Document]):
    for file, document in documents.items():
        for target in document.loads:
            path = target.partition("#")[0].partition("?")[0]
            assert not re.match(r"\w+:|//", target) or target.startswith("data:"), (file, target)
            assert not path or (file.parent / path).exists(), (file, target)
    assert "http" not in " ".join(Document(site / "404.html").loads)
    for sheet in site.rglob("*.css"):
        assert not re.search(r"@import|url\(['\"]?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet
    # The theme would load a program from elsewhere to draw one.
    assert not any('class="mermaid"' in file.read_text(encoding="utf-8") for file in documents)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_no_link_of_the_site_leads_nowhere(site: Path, documents: dict[Path, Document]):
    for file, document in documents.items():
        for target in document.links:
            if re.match(r"\w+:", target):
                continue
            path, _, place = target.partition("#")
            other = (file.parent / path).resolve() if path else file
            assert other.is_file(), (file, target)
            if other.suffix == ".html":
                assert place in documents[other].targets, (file, target)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_readme_examples_and_docstrings_are_in_it(site: Path, documents: dict[Path, Document]):
    text = (site / "index.html").read_text(encoding="utf-8")
    assert "Four RGB photos of a table" in text
    assert {"reference/model.html#neugrasp.model.network", "data_format.html"} <= documents[
        site / "index.html"
    ].links
    for example in (ROOT / "examples").glob("*.py"):
        assert f"python examples/{example.name}" in (site / "examples.html").read_text(encoding="utf-8")
    assert "neugrasp.grasp.Grasp.approach" in documents[site / "reference/grasp.html"].targets
    assert "pictures/data_flow.svg" in documents[site / "architecture.html"].loads
