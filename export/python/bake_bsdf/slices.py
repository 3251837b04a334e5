"""Writes tables of BSDF slices, which ``bake`` imports as the family ``imported``.

So any renderer's or measured BSDF can be baked: evaluate it on a grid of directions, and write it here. Directions
are those of the shading frame (z = normal), away from the surface: ``wo`` to the camera, ``wi`` to the light. One
row is one slice: the BSDF over all ``wi`` for one set of parameters and one ``wo``.

The file is safetensors (https://github.com/huggingface/safetensors) with three F32 tensors:

==========  ================  =================================================================================
``params``  ``[N, P]``        parameters of row n, finite; P may be 0
``wo``      ``[N, 2]``        θ in [0, 90) and φ of the direction to the camera, degrees
``f_cos``   ``[N, H, W, 3]``  f·cos θ_i, linear RGB, sr⁻¹, in [0, 1e20]
==========  ================  =================================================================================

and these keys in its ``__metadata__``: ``bake.import``, the format version "1"; ``param_names``, a JSON list of P
distinct names (p0, p1, … when absent); ``description``, any text (optional).

Pixel (row i, column j) of a slice is the cell with centre x = −1 + (2j+1)/W, y = −1 + (2i+1)/H of the orthographic
disk, where x and y are those of ``wi`` (see :func:`disk_grid`). Cells whose centre is not inside the unit circle are
ignored. Write the value at the centre, or the mean of f over the part of the cell inside the circle times the
centre's cos θ_i: what is interpolated is f = f_cos / cos θ_i.

The rows form a full grid, in any order: (distinct values of each parameter) × (distinct θ) × (distinct φ). With one
φ alone the BSDF is isotropic, and slices are turned to the azimuth of ``wo``. With several, they must go round the
circle: no gap may exceed 120 degrees. Between θ_o, φ_o and parameters f is interpolated linearly, so lobes fade
over instead of moving: tabulate so densely that neighbouring lobes overlap, and densest towards the horizon;
include θ = 0. Beyond the last θ, the last slice stays.
"""

import itertools
import json
import os
import struct
from pathlib import Path

import numpy as np

FORMAT = "1"
"""The format version that is written."""

F_COS_MAX = 1e20
"""Largest f_cos that is accepted, sr⁻¹."""

PHI_GAP_MAX = 120.5
"""Widest gap between neighbouring azimuths, degrees; half a degree of it is for round-off."""

ALIGNMENT = 8
"""The header of a safetensors file is padded to a multiple of this many bytes."""


def disk_grid(height, width):
    """Directions of the pixels of a slice: ``wi`` ``[H, W, 3]``, unit vectors, and ``mask`` ``[H, W]``.

    Outside the disk ``mask`` is false and ``wi`` is (0, 0, 1), so that a BSDF can be asked there, too.
    """
    if height < 1 or width < 1:
        raise ValueError(f"a slice of {height} × {width} pixels has no pixels")
    # In units of 1/H and 1/W; integers decide which centres are inside, as they do in the program that reads.
    y, x = np.meshgrid(2 * np.arange(height) + 1 - height, 2 * np.arange(width) + 1 - width, indexing="ij")
    room = (height * width) ** 2 - (x * height) ** 2 - (y * width) ** 2
    mask = room > 0
    z = np.sqrt(np.where(mask, room, 0.0)) / (height * width)
    wi = np.stack([x / width, y / height, z], axis=-1)
    return np.where(mask[..., None], wi, (0.0, 0.0, 1.0)), mask


def write_slices(path, params, wo, f_cos, param_names=None, description=None):
    """Writes a table to ``path``, whole or not at all.

    ``params`` ``[N, P]`` (None where there are none), ``wo`` ``[N, 2]``, ``f_cos`` ``[N, H, W, 3]``: as the module
    says. Pixels outside the disk are written as 0, whatever they hold. Raises :class:`ValueError` naming the array,
    the element and the value where something is wrong, and then writes nothing.
    """
    f_cos = _array("f_cos", f_cos, 4, "[N, H, W, 3]")
    n, height, width, channels = f_cos.shape
    if min(n, height, width) < 1 or channels != 3:
        raise ValueError(f"f_cos is {list(f_cos.shape)}, but must be [N, H, W, 3] with N, H and W at least 1")
    params = _array("params", np.empty((n, 0)) if params is None else params, 2, "[N, P]")
    wo = _array("wo", wo, 2, "[N, 2]")
    if wo.shape != (n, 2) or len(params) != n:
        raise ValueError(f"f_cos has {n} rows, but wo is {list(wo.shape)} and params {list(params.shape)}")
    _refuse("params", params, ~np.isfinite(params), "must be finite")
    _refuse("wo", wo, ~np.isfinite(wo), "must be finite")
    _refuse("wo", wo, ((wo < 0) | (wo >= 90)) & [True, False], "theta must lie in [0, 90) degrees")
    _, mask = disk_grid(height, width)
    f_cos = np.where(mask[..., None], f_cos, np.float32(0))
    _refuse("f_cos", f_cos, ~((f_cos >= 0) & (f_cos <= F_COS_MAX)), f"must lie in [0, {F_COS_MAX:g}]")
    names = _names(param_names, params.shape[1])
    _check_grid(params, wo, names)
    metadata = {"bake.import": FORMAT, "param_names": json.dumps(names)}
    if description is not None:
        metadata["description"] = str(description)
    _write(Path(path), {"params": params, "wo": wo, "f_cos": f_cos}, metadata)


def _array(name, values, rank, layout):
    """``values`` as little-endian float32; numbers too large for it become infinite."""
    with np.errstate(over="ignore"):
        array = np.ascontiguousarray(values, dtype="<f4")
    if array.ndim != rank:
        raise ValueError(f"{name} is {list(array.shape)}, but must be {layout}")
    return array


def _refuse(name, array, bad, reason):
    """Raises for the first element of ``array`` that is ``bad``."""
    found = np.argwhere(bad)
    if len(found):
        index = tuple(int(i) for i in found[0])
        raise ValueError(f"{name}[{', '.join(map(str, index))}] is {array[index]}, but {reason}")


def _names(names, count):
    """The names of ``count`` parameters, checked."""
    names = [f"p{i}" for i in range(count)] if names is None else [str(name) for name in names]
    if len(names) != count:
        raise ValueError(f"{len(names)} param_names for params with {count} columns")
    if len(set(names)) < count or not all(name and name.isprintable() for name in names):
        raise ValueError(f"param_names must be distinct, printable and not empty, not {names}")
    return names


def _check_grid(params, wo, names):
    """Raises unless the rows are all combinations of their values, once each, and φ goes round the circle."""
    phi = np.mod(wo[:, 1], np.float32(360))
    # The remainder of a tiny negative angle rounds to a whole turn.
    columns = [*params.T, wo[:, 0], np.where(phi < 360, phi, np.float32(0))]
    # Adding 0 makes one zero of two.
    axes, digits = zip(*(np.unique(column + 0, return_inverse=True) for column in columns), strict=True)
    names = [*names, "theta", "phi"]

    def tell(key):
        return ", ".join(f"{name} = {axis[i]}" for name, axis, i in zip(names, axes, key, strict=True))

    rows = {}
    for row, key in enumerate(zip(*(d.tolist() for d in digits), strict=True)):
        if key in rows:
            raise ValueError(f"rows {rows[key]} and {row} are both for {tell(key)}")
        rows[key] = row
    # One of the first N + 1 combinations is missing if any is.
    for key in itertools.islice(itertools.product(*(range(len(axis)) for axis in axes)), len(rows) + 1):
        if key not in rows:
            counts = " × ".join(str(len(axis)) for axis in axes)
            raise ValueError(f"no row has {tell(key)}, but the rows must hold all {counts} combinations")
    circle = np.append(axes[-1], axes[-1][0] + 360)
    widest = np.argmax(np.diff(circle))
    if len(axes[-1]) > 1 and np.diff(circle)[widest] > PHI_GAP_MAX:
        raise ValueError(
            f"the azimuths of wo leave a gap from {circle[widest]} to {circle[widest + 1]} degrees, but they must go "
            "round the circle (or be one alone, where the BSDF is isotropic)"
        )


def _write(path, tensors, metadata):
    """A safetensors file, under a temporary name first."""
    header, end = {"__metadata__": metadata}, 0
    for name, array in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(array.shape), "data_offsets": [end, end + array.nbytes]}
        end += array.nbytes
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(struct.pack("<Q", len(text)) + text)
            for array in tensors.values():
                file.write(array.tobytes())
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
