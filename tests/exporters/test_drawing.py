"""The drawing in docs/conventions.md is that of the exporters."""

from __future__ import annotations

import os
from xml.etree import ElementTree

from frames_drawing import FILE, drawing


def test_the_drawing_is_up_to_date():
    """`UPDATE_DOCS=1 pytest tests/exporters/test_drawing.py` draws it again."""
    text = drawing()
    ElementTree.fromstring(text)
    if os.environ.get("UPDATE_DOCS"):
        FILE.write_text(text, encoding="utf-8")
    assert FILE.read_text(encoding="utf-8") == text
