"""Reads the database of importance maps that ``bake maps`` writes.

It is a folder of shards ``maps-0000.safetensors``, ``maps-0001.safetensors``, … without a gap; each holds some entries.
Its tensors, for N entries in all, P free parameters and maps of n × n cells:

===============  ===============  ====  =============================================================================
``parameters``   ``[N, P]``       F64   values of the free parameters
``wo``           ``[N, 3]``       F64   direction to the camera, unit, shading frame (z = normal)
``charts``       ``[N]``          U8    charts of the entry, 1 or 2; what is said below holds for each
``share``        ``[N]``          F64   share of u₀ that the first chart has; the rest is the second's
``frame``        ``[N, 2, 5]``    F64   x, y, shear, b₀ and b₁ of the chart's lobe frame, NaN where it has none
``log_density``  ``[N,2,3,n,n]``  F32   logarithm of the target's RGB density in the frame's square
``map``          ``[N,2,n,n,2]``  F32   where the map takes the cell centres of u, in the frame's square
``potential``    ``[N, 2, n, n]`` F32   what the map is the gradient of
``constant``     ``[N, 2]``       F64   c of the solved equation, near 0
``residual``     ``[N, 2]``       F64   residual at which the solver stopped
``fallback``     ``[N, 2]``       U8    1 where the solver failed and the marginal map took its place
===============  ===============  ====  =============================================================================

Cells are indexed ``[row, column]``: row is u₁ (or y), column is u₀ (or x), both upwards from the first.
Whatever other tensors the shards hold are read in the same way.
"""

import json
import re
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open

SHARD = re.compile(r"maps-(\d{4,})\.safetensors")
"""Names of shards."""


def read_maps(folder):
    """The tensors of a database, and what the shards say of themselves.

    Returns ``(tensors, metadata)``: a dict of arrays whose first axis is the entry, and the parsed ``bake.maps`` of
    every shard. Raises :class:`FileNotFoundError` when there is no shard or one is missing, and :class:`ValueError`
    naming the shard that is damaged or whose tensors are not those of the first.
    """
    numbers = {int(match[1]): path for path in Path(folder).iterdir() if (match := SHARD.fullmatch(path.name))}
    if missing := sorted(set(range(max(numbers, default=0) + 1)) - set(numbers)):
        raise FileNotFoundError(f"{folder}: maps-{missing[0]:04}.safetensors is missing")
    shards, metadata = [], []
    for _, path in sorted(numbers.items()):
        try:
            with safe_open(path, framework="numpy") as file:
                shards.append({name: file.get_tensor(name) for name in file.keys()})
                metadata.append(json.loads((file.metadata() or {})["bake.maps"]))
        except (SafetensorError, KeyError, json.JSONDecodeError) as error:
            raise ValueError(f"{path}: not a shard of maps, or damaged: {error}") from error
        if _layout(shards[-1]) != _layout(shards[0]):
            raise ValueError(f"{path}: holds {_layout(shards[-1])}, but the first shard {_layout(shards[0])}")
    return {name: np.concatenate([shard[name] for shard in shards]) for name in shards[0]}, metadata


def _layout(tensors):
    """Names, types and shapes of a shard's tensors, but for the number of its entries."""
    return {name: (str(array.dtype), array.shape[1:]) for name, array in sorted(tensors.items())}
