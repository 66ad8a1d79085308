"""One HTML file that holds everything it shows: no network, no folder beside it."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Sequence

from PIL import Image as Picture

from neugrasp.observation import Image

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2330; background: #f4f5f7; margin: 0; }
main { max-width: 1180px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 34px 0 10px; }
p.lead { margin: 0 0 18px; color: #4a5365; }
section { background: #fff; border: 1px solid #dfe3ea; border-radius: 10px; padding: 14px 18px; }
table { border-collapse: collapse; width: 100%; }
th { text-align: left; font-weight: 600; color: #4a5365; border-bottom: 2px solid #dfe3ea; 
  padding: 6px 10px; }
td { vertical-align: top; border-bottom: 1px solid #eceff3; padding: 6px 10px; }
tr:last-child td { border-bottom: none; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.badge { display: inline-block; border-radius: 20px; padding: 1px 12px; font-weight: 600; font-size: 13px; }
.green { background: #dcf5e3; color: #14682f; } .yellow { background: #fff1c9; color: #7a5600; }
.red { background: #fde0de; color: #a01d14; } .grey { background: #e8ebf0; color: #4a5365; }
.remedy { color: #4a5365; } .meaning { color: #6a7283; font-size: 13.5px; }
.pictures { display: grid; gap: 12px; grid-template-columns: repeat(auto-fill, minmax(var(--width), 1fr)); }
figure { margin: 0; } figure img { width: 100%; display: block; border-radius: 6px; }
figcaption { font-size: 13px; color: #4a5365; padding: 4px 2px; }
code { background: #eef0f4; border-radius: 4px; padding: 1px 5px; }
"""


def page(title: str, lead: str, sections: Sequence[str]) -> str:
    """A whole document of sections that are HTML already; the title and the lead are text."""
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{text(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width">\n<style>{STYLE}</style>\n<main>\n'
        f'<h1>{text(title)}</h1>\n<p class="lead">{text(lead)}</p>\n'
        + "\n".join(sections)
        + "\n</main>\n</html>\n"
    )


def text(words: str) -> str:
    """Text as HTML."""
    return html.escape(words)


def marked(words: str) -> str:
    """Text as HTML, with `what stands between backticks` as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", text(words))


def section(heading: str, *body: str) -> str:
    """A heading and a box with HTML."""
    return f"<h2>{text(heading)}</h2>\n<section>" + "\n".join(body) + "</section>"


def badge(word: str, colour: str) -> str:
    """A word on a coloured ground: green, grey, yellow or red."""
    return f'<span class="badge {text(colour)}">{text(word)}</span>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """Rows of cells that are HTML already; the columns in `numeric` are aligned to the right."""
    cells = "".join(
        f'<th class="number">{text(word)}</th>' if i in numeric else f"<th>{text(word)}</th>"
        for i, word in enumerate(head)
    )
    lines = [
        "<tr>"
        + "".join(
            f'<td class="number">{c}</td>' if i in numeric else f"<td>{c}</td>" for i, c in enumerate(row)
        )
        + "</tr>"
        for row in rows
    ]
    return f"<table><thead><tr>{cells}</tr></thead><tbody>" + "\n".join(lines) + "</tbody></table>"


def pictures(figures: Sequence[tuple[Image, str]], width: int = 320) -> str:
    """Pictures with captions, side by side where there is room for `width` pixels each."""
    return (
        f'<div class="pictures" style="--width:{width}px">'
        + "".join(
            f'<figure><img alt="{text(caption)}" src="{data_uri(image)}">'
            f"<figcaption>{text(caption)}</figcaption></figure>"
            for image, caption in figures
        )
        + "</div>"
    )


def data_uri(image: Image, quality: int = 88) -> str:
    """A photo as a JPEG inside of a document."""
    stream = io.BytesIO()
    Picture.fromarray(image).save(stream, format="JPEG", quality=quality)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
