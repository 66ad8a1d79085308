"""Tests in a real browser: whether there can be any."""

from __future__ import annotations

import importlib.util

from neugrasp.errors import InputError
from neugrasp.viewer.browser import find_browser


def no_browser(module: str) -> str:
    """Why there can be no test in a browser, which needs this module, or nothing."""
    if importlib.util.find_spec(module) is None:
        return f"{module} is not installed (pip install 'neugrasp[view]')"
    try:
        find_browser()
    except InputError as error:
        return str(error)
    return ""
