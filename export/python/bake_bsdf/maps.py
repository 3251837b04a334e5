"""Reads the database of importance maps that ``bake maps`` writes.

It is a folder of shards ``maps-0000.safetensors``, ``maps-0001.safetensors``, … without a gap; each holds some entries.
Its tensors, for N entries in all, P free parameters, room for C charts an entry (2 for the families layered and
principled, else 1) and maps of n × n cells:

===================  ===============  ====  =========================================================================
``parameters``       ``[N, P]``       F64   values of the free parameters
``wo``               ``[N, 3]``       F64   direction to the camera, unit, shading frame (z = normal)
``smoothing_error``  ``[N]``          F64   what removing the noise of walks costs the density, over its albedo
``charts``           ``[N]``          U8    charts of the entry, 1 to C; what is said below holds for each
``share``            ``[N, C]``       F64   probability of the chart: the share of u₀ that it has, in this order
``frame``            ``[N, C, 5]``    F64   x, y, shear, b₀ and b₁ of the chart's lobe frame
``boost``            ``[N, C, 2]``    F64   velocity of the chart's boost
``residuals``        ``[N, C, 5]``    F64   c of the solved equation, near 0; its residual; mass that the density was
                                            softened by; shares of the square that fold, and that are not covered
``fallback``         ``[N, C]``       U8    1 where the solver failed and the marginal map took its place
``log_density``      ``[N,C,3,n,n]``  F32   logarithm of the RGB density in the chart's square, on crowded cells
``map``              ``[N,C,n,n,2]``  F32   where the map takes the cell centres of u: in the chart's square for the
                                            solver ``frame``, on the disk, [−1, 1]², for any other
``potential``        ``[N, C, n, n]`` F32   coefficients of the potential whose gradient the map is
===================  ===============  ====  =========================================================================

What a chart that is not there would hold is NaN, or 0 in ``fallback``; so is the potential where there is none.
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
