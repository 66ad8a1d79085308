"""What the site has beyond the pages of docs/: the README as its index, examples, and the reference."""

from __future__ import annotations

import ast
import hashlib
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "src" / "neugrasp"
LINK = re.compile(r"(\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^)#\s]+)(#[^)\s]+)?\)")
WORKER, WORKER_ELSEWHERE = "assets/iframe-worker.js", "https://unpkg.com/iframe-worker/shim"
"""What the search needs in pages opened from the disk: here, and where the theme would load it from."""
DIAGRAM = re.compile(r"^```mermaid\n(.*?)^```$", re.DOTALL | re.MULTILINE)
DRAWN = "pictures/data_flow.svg"
"""The one diagram, drawn beforehand: a browser that draws mermaid would have to load it from elsewhere."""
OUTSIDE = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "README.md": "index.md",
    "examples": "examples.md",
    "src/neugrasp/grippers": "data_format.md#a-gripper-neugrasp-gripper-version-1",
}
"""Where links from the top of the repository lead on the site."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Adds a page for every part of the package to the menu."""
    pages = [{part: f"reference/{part}.md"} for part in parts()]
    config.nav = [*(config.nav or []), {"Reference": pages}]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made of something else."""
    for source, page in (
        ("README.md", "index.md"),
        ("CHANGELOG.md", "changelog.md"),
        ("CONTRIBUTING.md", "contributing.md"),
    ):
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=moved_links(text)))
    files.append(File.generated(config, "examples.md", content=examples_page()))
    worker = (ROOT / "docs/site/iframe-worker.js").read_text(encoding="utf-8")
    files.append(File.generated(config, WORKER, content=worker))
    for part, modules in parts().items():
        files.append(File.generated(config, f"reference/{part}.md", content=reference_page(part, modules)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Puts the drawn diagram in the place of its source."""
    return DIAGRAM.sub(lambda match: drawn(match.group(1)), markdown)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Loads from here what the theme would load from elsewhere."""
    return output.replace(WORKER_ELSEWHERE, "../" * page.url.count("/") + WORKER)


def on_post_template(output_content: str, template_name: str, config: MkDocsConfig) -> str:
    """The same for the page that says that there is no such page."""
    return output_content.replace(WORKER_ELSEWHERE, WORKER)


def moved_links(text: str) -> str:
    """Markdown from the top of the repository with links as they are on the site."""

    def moved(match: re.Match[str]) -> str:
        words, target, place = match.group(1), match.group(2), match.group(3) or ""
        if "://" in target:
            return match.group(0)
        if target in OUTSIDE:
            return f"{words}({OUTSIDE[target]})"
        if target.startswith("docs/"):
            return f"{words}({target.removeprefix('docs/')}{place})"
        if target.startswith("src/neugrasp/") and target.endswith(".py"):
            name = module_name(ROOT / target)
            return f"{words}(reference/{name.split('.')[1]}.md#{name})"
        raise PluginError(f"{target}: a link that has no place on the site; name it in docs/site/hooks.py")

    # A picture may be inside a link: from the inside out.
    return LINK.sub(moved, text)


def examples_page() -> str:
    """Every example: its page, then its code."""
    sections = [
        "# Examples\n\nEach is one file of less than 80 lines in `examples/`; the tests run them all."
    ]
    for file in sorted((ROOT / "examples").glob("*.py")):
        code = file.read_text(encoding="utf-8")
        tree = ast.parse(code)
        title, _, rest = (ast.get_docstring(tree) or file.stem).partition("\n")
        end = tree.body[0].end_lineno or 0
        body = "\n".join(code.splitlines()[end:]).strip()
        sections.append(
            f"## {file.stem[:2]}: {title.rstrip('.')}\n\n{rest.strip(chr(10))}\n\n```python\n{body}\n```"
        )
    return "\n\n".join(sections) + "\n"


def parts() -> dict[str, list[str]]:
    """The modules of every part of the package."""
    found: dict[str, list[str]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        name = module_name(file)
        if name != "neugrasp":
            found.setdefault(name.split(".")[1], []).append(name)
    return dict(sorted(found.items()))


def module_name(file: Path) -> str:
    """ "neugrasp.model.sdf" of src/neugrasp/model/sdf.py; a package is its folder."""
    words = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(words[:-1] if words[-1] == "__init__" else words)


def reference_page(part: str, modules: list[str]) -> str:
    """The docstrings of a part; of a package's own file only its first words."""
    sections = []
    for name in modules:
        options = [f"heading_level: {1 if name == f'neugrasp.{part}' else 2}"]
        if PACKAGE.parent.joinpath(*name.split(".")).is_dir():
            options.append("members: false")
        sections.append("\n      ".join([f"::: {name}\n    options:", *options]))
    return "\n\n".join(sections) + "\n"


def drawn(source: str) -> str:
    """The picture of a diagram. Raises `PluginError` where it was drawn from another source."""
    digest = hashlib.sha256(source.encode()).hexdigest()
    if digest not in (ROOT / "docs" / DRAWN).read_text(encoding="utf-8"):
        raise PluginError(
            f"docs/{DRAWN} was drawn from another diagram: draw it again from the mermaid block (with "
            f"htmlLabels off) and write its sha256, {digest}, into the first line"
        )
    return f"![The way of the data]({DRAWN})"
