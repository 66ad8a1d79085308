"""The metrics.json of an evaluation, as the page of results reads it."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

from neugrasp.data.fields import Fields, is_number
from neugrasp.data.strict_json import read_json
from neugrasp.errors import InputError
from neugrasp.evaluation.results_io import FORMAT, VERSION

WORDS = ("detector", "scene", "materials", "strategy", "protocol", "views", "command", "commit", "machine")
COUNTS = ("seed", "successes", "attempts", "rounds", "objects")
RATES = ("SR", "FSR", "DR")
TABLES = ("failures", "endings", "seconds_by_stage")
MANY = 10**12

log = logging.getLogger(__name__)


def read_metrics(folder: Path) -> dict[str, dict[str, Any]]:
    """All metrics in a folder by name, sorted: NAME.json and NAME/metrics.json. Other JSON is left out, with
    a word. Raises `InputError` where there is none, or one is damaged."""
    files = {path.stem: path for path in folder.glob("[!.]*.json")}
    files |= {path.parent.name: path for path in folder.glob("[!.]*/metrics.json")}
    rows = {}
    for name, path in sorted(files.items()):
        data = read_json(path, "the metrics.json of `neugrasp evaluate`")
        if isinstance(data, dict) and data.get("format") == FORMAT:
            rows[name] = _checked(Fields(str(path), data))
        else:
            log.warning("%s: not the metrics.json of `neugrasp evaluate`; left out", path)
    if not rows:
        raise InputError(f"{folder}: holds neither NAME.json nor NAME/metrics.json of `neugrasp evaluate`")
    order = ("scene", "materials", "detector", "views", "strategy")
    return dict(sorted(rows.items(), key=lambda item: [str(item[1][key]) for key in order]))


def _checked(fields: Fields) -> dict[str, Any]:
    """The same, of which everything that the page needs is there and of its type."""
    fields.expect(FORMAT, VERSION)
    for word in WORDS:
        fields.text(word)
    for count in COUNTS:
        fields.whole(count, 0, MANY)
    for rate in RATES:
        if fields.get(rate) is not None:
            fields.number(rate, 0, 100, "%")
            fields.numbers(f"{rate}_ci", 2, 100, "[low, high] in percent")
    for table in TABLES:
        fields.inside(table).each_number(0, MANY)
    fields.number("seconds_per_round", 0, MANY, "s")
    fields.list("crashed")
    if fields.get("depth") is not None:
        fields.text("depth")
    if fields.get("L1") is not None:
        fields.number("L1", 0, 2)
        for constant in ("-1", "+0", "+1"):
            fields.inside("L1_constants").inside(constant).number("0.3", 0, 2)
    _check_optional(fields)
    return fields.data


def _check_optional(fields: Fields) -> None:
    """What newer versions write, too."""
    for name in ("weights", "split"):
        if name in fields.data:
            fields.text(name)
    if "samples" in fields.data:
        fields.whole("samples", 1, 2**16)
    if "hand_check" in fields.data:
        fields.flag("hand_check")
    if "trained" in fields.data:
        trained = fields.inside("trained")
        for name, value in trained.data.items():
            if not isinstance(value, str) and not is_number(value):
                raise trained.refuse(name, "is neither a word nor a number")
    if fields.data.get("by_material"):
        kinds = fields.inside("by_material")
        for kind in kinds.data:
            for count in ("taken", "objects", "share"):
                kinds.inside(kind).number(count, 0, MANY)
