"""Where a run begins that does not begin from nothing."""

from __future__ import annotations

import logging
from typing import Any

from torch import nn

from neugrasp.errors import InputError
from neugrasp.model.checkpoint import NEUGRASP, find_weights, load_checkpoint, load_network, network_of
from neugrasp.training.networks import NetworkSpec

log = logging.getLogger(__name__)


def start_from(model: Any, weights: str, network: str, spec: NetworkSpec) -> None:
    """Gives a network the weights of that name or file: all of them where they are of the same `network` and
    configuration, else those of the grasp head alone.

    Raises `InputError` where there are none, or the heads differ, too.
    """
    path = find_weights(weights)
    same = network_of(path) == network != NEUGRASP
    found: Any = (
        load_network(path, network, type(model.config), spec.build) if same else load_checkpoint(path).model()
    )
    if found.workspace.cube != model.workspace.cube:
        log.warning(
            "%s: was trained for %s; the scenes are about %s",
            weights,
            found.workspace.describe(),
            model.workspace.describe(),
        )
    if type(found) is type(model) and found.config == model.config:
        model.load_state_dict(found.state_dict())
        return
    given, wanted = _head(found), _head(model)
    if wanted is None or given is None or _shapes(given) != _shapes(wanted):
        raise InputError(f"{weights}: its network is configured differently from the recipe's, its head too")
    log.warning("%s: another network than the recipe's, so only its grasp head is taken", weights)
    wanted.load_state_dict(given.state_dict())


def _head(model: nn.Module) -> nn.Module | None:
    return getattr(model, "head", None)


def _shapes(module: nn.Module) -> dict[str, Any]:
    return {name: tensor.shape for name, tensor in module.state_dict().items()}
