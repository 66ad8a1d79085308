"""Records as training reads them: what no loss needs stays on disk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neugrasp.data.packing import pack
from neugrasp.data.records import write_record
from neugrasp.data.scene_sets import read_records
from neugrasp.data.shards import Shards
from neugrasp.data.trials import State
from neugrasp.execution import SLIPPED
from neugrasp.simulation.grasp_execution import Trial
from neugrasp.simulation.grasp_trials import as_trials


def test_records_are_read_without_their_trials_which_no_loss_reads(make_record, tmp_path):
    record = make_record()
    state = State(replace(record.scene, materials=()), record.tsdf)
    trials = as_trials(np.eye(4)[None], [Trial(False, SLIPPED, 0.08)], state, {"source": "labels"})
    write_record(tmp_path / "scenes" / record.name, replace(record, trials=trials))
    pack([tmp_path / "scenes"], tmp_path / "packed")
    assert Shards(tmp_path / "packed")[0].trials is not None
    for folder in ("scenes", "packed"):
        (found,) = read_records(tmp_path / folder)
        assert found.name == record.name
        assert found.trials is None
