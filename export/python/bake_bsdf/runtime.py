"""Runs the ONNX files of a baked material with onnxruntime.

Directions are unit vectors of the shading frame (z = normal), away from the surface: ``wo`` to the camera,
``wi`` to the light. Encodings, charts and Jacobian are inside the files, so nothing here is mathematics.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime

FORMAT = 2
"""The format version this package reads."""

SPEC_KEY = "bake.spec"
"""Key of the network's specification in the metadata of each file."""


class Sample(NamedTuple):
    """What :meth:`BakedMaterial.sample` draws."""

    wi: np.ndarray
    """``[N, 3]``, unit directions to the light."""
    weight: np.ndarray
    """``[N, 3]``, learned f·cos θ_i / pdf, RGB, dimensionless."""
    jacobian: np.ndarray
    """``[N, 1]``, sr, with the sign of u ↦ solid angle; times f·cos θ_i it is an unbiased weight."""


class Parameter(NamedTuple):
    """A parameter that the material leaves free."""

    name: str
    """As material files have it, with its component where there are several: ``roughness``, ``alpha[0]``."""
    min: float
    """Smallest value that the networks were trained for."""
    max: float
    """Largest value."""


class BakedMaterial:
    """A baked material: the folder that holds ``sample.onnx``, ``eval.onnx`` and ``pdf.onnx``.

    Runs on one thread. Where :attr:`parameters` is not empty, every query takes ``params``: ``[N, k]``, or ``[k]`` for
    all. A query with a parameter that is not finite, or a direction that is not finite or not above the horizon, gives
    zeros and ``wi`` = (0, 0, 1).
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        self._sessions = {role: _open(self.folder / f"{role}.onnx") for role in ("sample", "eval", "pdf")}
        self.spec = {role: _read_spec(self.folder, role, s) for role, s in self._sessions.items()}
        """The specification of each network, as plain dictionaries."""
        self.material = self.spec["sample"]["material"]
        """What was baked: name, family and parameters."""
        self.parameters = _free_parameters(self.material)
        """The :class:`Parameter` of every column of ``params``, in order."""

    def sample(self, wo, u, params=None) -> Sample:
        """Draws ``wi`` for ``wo`` ``[N, 3]`` and uniforms ``u`` ``[N, 2]`` in [0, 1)."""
        return Sample(*self._run("sample", params, wo=(wo, 3), u=(u, 2)))

    def eval(self, wo, wi, params=None) -> np.ndarray:
        """f·cos θ_i, RGB ``[N, 3]``, sr⁻¹."""
        return self._run("eval", params, wo=(wo, 3), wi=(wi, 3))[0]

    def pdf(self, wo, wi, params=None) -> np.ndarray:
        """Learned density of ``wi``, ``[N, 1]``, sr⁻¹: for weights of multiple importance sampling only."""
        return self._run("pdf", params, wo=(wo, 3), wi=(wi, 3))[0]

    def _run(self, role, params, **inputs):
        feed = {name: _rows(name, array, width) for name, (array, width) in inputs.items()}
        if self.parameters:
            feed["params"] = self._params(params, len(feed["wo"]))
        elif params is not None:
            raise ValueError(f"params: material `{self.material['name']}` leaves nothing free")
        lengths = {name: len(array) for name, array in feed.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"{role}: inputs differ in length: {lengths}")
        return self._sessions[role].run(None, feed)

    def _params(self, params, count):
        names = ", ".join(parameter.name for parameter in self.parameters)
        if params is None:
            raise ValueError(f"params: material `{self.material['name']}` leaves free {names}; give their values")
        width = len(self.parameters)
        if np.shape(params) == (width,):
            params = np.broadcast_to(params, (count, width))
        return _rows("params", params, width)


def _free_parameters(material):
    """The parameters whose range is not a single value, in the order of the graphs' columns."""
    free = []
    for name, setting in material.items():
        scalars = setting if isinstance(setting, list) else [setting]
        for i, scalar in enumerate(scalars):
            if isinstance(scalar, dict) and "min" in scalar and scalar["min"] != scalar["max"]:
                label = f"{name}[{i}]" if isinstance(setting, list) else name
                free.append(Parameter(label, scalar["min"], scalar["max"]))
    return free


def _rows(name, array, width):
    """``array`` as float32 ``[N, width]``."""
    rows = np.ascontiguousarray(array, dtype=np.float32)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name} must be [N, {width}], not {list(rows.shape)}")
    return rows


def _open(path):
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; export the material first")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no narrower base
        raise ValueError(f"{path}: onnxruntime refuses it: {error}") from error


def _read_spec(folder, role, session):
    path = folder / f"{role}.onnx"
    text = session.get_modelmeta().custom_metadata_map.get(SPEC_KEY)
    if text is None:
        raise ValueError(f"{path}: its metadata has no `{SPEC_KEY}`, so another program wrote it")
    spec = json.loads(text)
    if spec["format"] != FORMAT:
        raise ValueError(f"{path}: its format version is {spec['format']}, this package reads {FORMAT}")
    if spec["role"] != role:
        raise ValueError(f"{path}: it is a {spec['role']} network")
    return spec
