"""Runs the ONNX files of a baked material with onnxruntime.

Directions are unit vectors of the shading frame (z = normal), away from the surface: ``wo`` to the camera,
``wi`` to the light. Encodings, frame and Jacobian are inside the files, so nothing here is mathematics.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnxruntime

FORMAT = 1
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
    """``[N, 1]``, signed determinant of u ↦ solid angle, sr; times f·cos θ_i it is an unbiased weight."""


class BakedMaterial:
    """A baked material: the folder that holds ``sample.onnx``, ``eval.onnx`` and ``pdf.onnx``.

    Runs on one thread. A query with a direction that is not finite or not above the horizon gives zeros and
    ``wi`` = (0, 0, 1).
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        self._sessions = {role: _open(self.folder / f"{role}.onnx") for role in ("sample", "eval", "pdf")}
        self.spec = {role: _read_spec(self.folder, role, s) for role, s in self._sessions.items()}
        """The specification of each network, as plain dictionaries."""
        self.material = self.spec["sample"]["material"]
        """What was baked: name, family and parameters."""

    def sample(self, wo, u) -> Sample:
        """Draws ``wi`` for ``wo`` ``[N, 3]`` and uniforms ``u`` ``[N, 2]`` in [0, 1)."""
        return Sample(*self._run("sample", wo=(wo, 3), u=(u, 2)))

    def eval(self, wo, wi) -> np.ndarray:
        """f·cos θ_i, RGB ``[N, 3]``, sr⁻¹."""
        return self._run("eval", wo=(wo, 3), wi=(wi, 3))[0]

    def pdf(self, wo, wi) -> np.ndarray:
        """Learned density of ``wi``, ``[N, 1]``, sr⁻¹: for weights of multiple importance sampling only."""
        return self._run("pdf", wo=(wo, 3), wi=(wi, 3))[0]

    def _run(self, role, **inputs):
        feed = {name: _rows(name, array, width) for name, (array, width) in inputs.items()}
        lengths = {name: len(array) for name, array in feed.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"{role}: inputs differ in length: {lengths}")
        return self._sessions[role].run(None, feed)


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
